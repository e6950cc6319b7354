/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadows of points by CUDA and umbrage's include.
 *
 *     nvcc -I/usr/local/share/umbrage/gpu cuda_shadows.cu -lumbrage-core -o shadows
 *     umbrage points city.glb -o points.f32 --kind gbuffer --normals
 *     ./shadows city.umb points.f32 >answers.f32
 *
 * points.f32 has six floats a point: place and normal. The answers are floats, 0 shadowed to 1 lit.
 */
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include <umbrage/gpu.h>
#include "umbrage.cuh"

struct Point {
    float3 place, normal;
};

__global__ void shade(const uint4 *data, UmbragePlacement sun, const Point *points, unsigned count,
                      int taps, float *light)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) {
        light[i] = umbrage_box(data, sun, points[i].place, points[i].normal, taps).x;
    }
}

static void expect(bool holds, const char *message)
{
    if (!holds) {
        fprintf(stderr, "shadows: %s\n", message);
        exit(1);
    }
}

/* Copies an array to the GPU. */
template <typename T> static T *upload(const std::vector<T> &from)
{
    T *to = NULL;
    expect(cudaMalloc(&to, from.size() * sizeof(T)) == cudaSuccess, "no memory on the GPU");
    expect(cudaMemcpy(to, from.data(), from.size() * sizeof(T), cudaMemcpyHostToDevice) == cudaSuccess, "no copy");
    return to;
}

static std::vector<Point> read_points(const char *path)
{
    std::vector<Point> points;
    Point point;
    FILE *file = fopen(path, "rb");
    expect(file != NULL, path);
    while (fread(&point, sizeof point, 1, file) == 1) {
        points.push_back(point);
    }
    fclose(file);
    return points;
}

int main(int argc, char **argv)
{
    expect(argc == 3, "usage: shadows ASSET POINTS >ANSWERS");
    struct umb_asset *asset = NULL;
    struct umb_error error = {};
    struct umb_gpu_layout layout = {};
    struct umb_gpu_view view = {};
    struct umb_gpu_placement placement = {};
    struct umb_gpu_precision precision = {};
    expect(umb_asset_open_file(argv[1], NULL, &asset, &error) == UMB_OK, error.message);
    expect(umb_gpu_layout_make(asset, 0, &layout, &error) == UMB_OK, error.message);
    expect(umb_gpu_place(asset, &view, &placement, &precision, &error) == UMB_OK, error.message);
    std::vector<uint4> entries(layout.entries);
    umb_gpu_write(asset, NULL, &layout, 0, layout.entries, &entries[0].x);
    umb_asset_close(asset);

    UmbragePlacement sun;
    memcpy(&sun, &placement, sizeof sun);
    const std::vector<Point> points = read_points(argv[2]);
    const unsigned count = (unsigned)points.size();
    std::vector<float> light(count);
    float *device_light = upload(light);
    shade<<<(count + 127) / 128, 128>>>(upload(entries), sun, upload(points), count, 9, device_light);
    expect(cudaMemcpy(light.data(), device_light, count * sizeof(float), cudaMemcpyDeviceToHost) == cudaSuccess,
           "the kernel failed");
    return fwrite(light.data(), sizeof(float), count, stdout) == count ? 0 : 1;
}
