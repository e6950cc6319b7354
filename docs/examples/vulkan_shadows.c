/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadows of points by a GPU, with Vulkan and umbrage's GLSL include.
 *
 *     glslangValidator -V -I/usr/local/share/umbrage/gpu vulkan_shadows.comp -o shadows.spv
 *     cc vulkan_shadows.c $(pkg-config --cflags --libs umbrage-core vulkan) -o shadows
 *     umbrage points city.glb -o points.f32 --kind gbuffer --normals
 *     ./shadows city.umb points.f32 shadows.spv >answers.f32
 *
 * points.f32 has six floats a point: place and normal. The answers are floats, 0 shadowed to 1 lit.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <umbrage/gpu.h>
#include <vulkan/vulkan.h>

#define TAPS 9

/* Ends the program with a message. */
static void end(const char *message)
{
    fprintf(stderr, "shadows: %s\n", message);
    exit(1);
}

static void expect(VkResult result, const char *what)
{
    if (result != VK_SUCCESS) {
        end(what);
    }
}

static void *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        end(path);
    }
    *size = (size_t)ftell(file);
    rewind(file);
    void *bytes = malloc(*size + 1);
    if (bytes == NULL || fread(bytes, 1, *size, file) != *size) {
        end(path);
    }
    fclose(file);
    return bytes;
}

/* --- Vulkan ----------------------------------------------------------------------------------- */

enum {
    ENTRIES,
    POINTS,
    LIGHT,
    SUN,
    BUFFERS
};

struct gpu {
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    VkBuffer buffers[BUFFERS];
    void *memory[BUFFERS]; /* Mapped */
    VkDescriptorSetLayout set_layout;
    VkDescriptorSet set;
    VkPipelineLayout layout;
    VkPipeline pipeline;
};

static void open_device(struct gpu *gpu)
{
    const VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                           .apiVersion = VK_API_VERSION_1_1};
    const VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                       .pApplicationInfo = &application};
    VkInstance instance;
    uint32_t one = 1, families = 16;
    VkQueueFamilyProperties family[16];
    expect(vkCreateInstance(&info, NULL, &instance), "Vulkan does not start");
    if (vkEnumeratePhysicalDevices(instance, &one, &gpu->physical) < 0 || one == 0) {
        end("there is no Vulkan device");
    }
    vkGetPhysicalDeviceQueueFamilyProperties(gpu->physical, &families, family);
    while (gpu->family < families && !(family[gpu->family].queueFlags & VK_QUEUE_COMPUTE_BIT)) {
        gpu->family++;
    }
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                           .queueFamilyIndex = gpu->family,
                                           .queueCount = 1,
                                           .pQueuePriorities = &priority};
    const VkDeviceCreateInfo device = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                       .queueCreateInfoCount = 1,
                                       .pQueueCreateInfos = &queue};
    expect(vkCreateDevice(gpu->physical, &device, NULL, &gpu->device), "no device");
    vkGetDeviceQueue(gpu->device, gpu->family, 0, &gpu->queue);
}

/* Makes a buffer in memory that both see. An engine copies it to the GPU's own memory. */
static void make_buffer(struct gpu *gpu, unsigned which, size_t size)
{
    const VkMemoryPropertyFlags wanted =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    const VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                     .size = size,
                                     .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT};
    VkMemoryRequirements needs;
    VkPhysicalDeviceMemoryProperties has;
    VkDeviceMemory memory;
    expect(vkCreateBuffer(gpu->device, &info, NULL, &gpu->buffers[which]), "no buffer");
    vkGetBufferMemoryRequirements(gpu->device, gpu->buffers[which], &needs);
    vkGetPhysicalDeviceMemoryProperties(gpu->physical, &has);
    uint32_t type = 0;
    while (type < has.memoryTypeCount &&
           (!(needs.memoryTypeBits >> type & 1) ||
            (has.memoryTypes[type].propertyFlags & wanted) != wanted)) {
        type++;
    }
    const VkMemoryAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                           .allocationSize = needs.size,
                                           .memoryTypeIndex = type};
    expect(vkAllocateMemory(gpu->device, &allocate, NULL, &memory), "no memory");
    expect(vkBindBufferMemory(gpu->device, gpu->buffers[which], memory, 0), "no memory");
    expect(vkMapMemory(gpu->device, memory, 0, size, 0, &gpu->memory[which]), "no memory");
}

static void bind_buffers(struct gpu *gpu)
{
    VkDescriptorSetLayoutBinding bindings[BUFFERS];
    VkDescriptorBufferInfo infos[BUFFERS];
    VkWriteDescriptorSet writes[BUFFERS];
    const VkDescriptorPoolSize size = {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, BUFFERS};
    const VkDescriptorPoolCreateInfo pool_info = {.sType =
                                                      VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                                  .maxSets = 1,
                                                  .poolSizeCount = 1,
                                                  .pPoolSizes = &size};
    VkDescriptorPool pool;
    for (uint32_t i = 0; i < BUFFERS; i++) {
        bindings[i] = (VkDescriptorSetLayoutBinding){i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1,
                                                     VK_SHADER_STAGE_COMPUTE_BIT, NULL};
    }
    const VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
        .bindingCount = BUFFERS,
        .pBindings = bindings};
    expect(vkCreateDescriptorSetLayout(gpu->device, &layout, NULL, &gpu->set_layout), "no layout");
    expect(vkCreateDescriptorPool(gpu->device, &pool_info, NULL, &pool), "no pool");
    const VkDescriptorSetAllocateInfo allocate = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
        .descriptorPool = pool,
        .descriptorSetCount = 1,
        .pSetLayouts = &gpu->set_layout};
    expect(vkAllocateDescriptorSets(gpu->device, &allocate, &gpu->set), "no descriptors");
    for (uint32_t i = 0; i < BUFFERS; i++) {
        infos[i] = (VkDescriptorBufferInfo){gpu->buffers[i], 0, VK_WHOLE_SIZE};
        writes[i] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = gpu->set,
                                           .dstBinding = i,
                                           .descriptorCount = 1,
                                           .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                           .pBufferInfo = &infos[i]};
    }
    vkUpdateDescriptorSets(gpu->device, BUFFERS, writes, 0, NULL);
}

static void make_pipeline(struct gpu *gpu, const char *path)
{
    size_t size;
    uint32_t *code = read_file(path, &size);
    const VkShaderModuleCreateInfo module_info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = code};
    const VkPipelineLayoutCreateInfo layout = {.sType =
                                                   VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                               .setLayoutCount = 1,
                                               .pSetLayouts = &gpu->set_layout};
    VkShaderModule module;
    expect(vkCreateShaderModule(gpu->device, &module_info, NULL, &module), path);
    expect(vkCreatePipelineLayout(gpu->device, &layout, NULL, &gpu->layout), "no layout");
    const VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                  .module = module,
                  .pName = "main"},
        .layout = gpu->layout};
    expect(vkCreateComputePipelines(gpu->device, VK_NULL_HANDLE, 1, &info, NULL, &gpu->pipeline),
           "no pipeline");
    free(code);
}

static void run(struct gpu *gpu, uint32_t groups)
{
    const VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                               .queueFamilyIndex = gpu->family};
    const VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VkCommandPool pool;
    VkCommandBuffer commands;
    expect(vkCreateCommandPool(gpu->device, &pool_info, NULL, &pool), "no commands");
    const VkCommandBufferAllocateInfo allocate = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
        .commandPool = pool,
        .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
        .commandBufferCount = 1};
    expect(vkAllocateCommandBuffers(gpu->device, &allocate, &commands), "no commands");
    expect(vkBeginCommandBuffer(commands, &begin), "no commands");
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, gpu->pipeline);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, gpu->layout, 0, 1, &gpu->set,
                            0, NULL);
    vkCmdDispatch(commands, groups, 1, 1);
    expect(vkEndCommandBuffer(commands), "no commands");
    const VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                                 .commandBufferCount = 1,
                                 .pCommandBuffers = &commands};
    expect(vkQueueSubmit(gpu->queue, 1, &submit, VK_NULL_HANDLE), "the GPU refuses the work");
    expect(vkQueueWaitIdle(gpu->queue), "the GPU failed");
}

/* --- umbrage ---------------------------------------------------------------------------------- */

/* Copies an asset's entries and the placement of its first light. */
static void load(struct gpu *gpu, const char *path, uint32_t count)
{
    struct umb_asset *asset;
    struct umb_error error;
    struct umb_gpu_layout layout;
    struct umb_gpu_placement placement;
    struct umb_gpu_precision precision;
    const struct umb_gpu_view view = {.bias_mode = UMB_BIAS_AUTO};
    const int32_t taps = TAPS;
    if (umb_asset_open_file(path, NULL, &asset, &error) != UMB_OK ||
        umb_gpu_layout_make(asset, 0, &layout, &error) != UMB_OK ||
        umb_gpu_place(asset, &view, &placement, &precision, &error) != UMB_OK) {
        end(error.message);
    }
    make_buffer(gpu, ENTRIES, (size_t)layout.entries * UMB_GPU_ENTRY_BYTES);
    umb_gpu_write(asset, NULL, &layout, 0, layout.entries, gpu->memory[ENTRIES]);
    make_buffer(gpu, SUN, sizeof placement + 16);
    memcpy(gpu->memory[SUN], &placement, sizeof placement);
    memcpy((uint8_t *)gpu->memory[SUN] + sizeof placement, &count, sizeof count);
    memcpy((uint8_t *)gpu->memory[SUN] + sizeof placement + 4, &taps, sizeof taps);
    umb_asset_close(asset);
}

int main(int argc, char **argv)
{
    struct gpu gpu = {0};
    size_t size;
    if (argc != 4) {
        fprintf(stderr, "usage: shadows ASSET POINTS SHADER >ANSWERS\n");
        return 2;
    }
    void *points = read_file(argv[2], &size);
    const uint32_t count = (uint32_t)(size / (6 * sizeof(float)));
    open_device(&gpu);
    load(&gpu, argv[1], count);
    make_buffer(&gpu, POINTS, size);
    make_buffer(&gpu, LIGHT, count * sizeof(float));
    memcpy(gpu.memory[POINTS], points, size);
    bind_buffers(&gpu);
    make_pipeline(&gpu, argv[3]);
    run(&gpu, (count + 63) / 64);
    free(points);
    return fwrite(gpu.memory[LIGHT], sizeof(float), count, stdout) == count ? 0 : 1;
}
