/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Runs a fuzz target over files without a fuzzer: seeds, and every input that ever broke it.
 * Then each file once more with single bytes changed, so that even without libFuzzer the target
 * sees damaged inputs; the changes come from a fixed generator.
 */
#include <dirent.h>
#include <string.h>

#include "fuzz.h"

static uint64_t random_state = 0x9e3779b97f4a7c15U;

static uint64_t next(void)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return random_state;
}

static int replay_file(const char *path, unsigned mutations)
{
    FILE *file = fopen(path, "rb");
    if (!file) {
        (void)fprintf(stderr, "%s: cannot be opened\n", path);
        return 1;
    }
    static uint8_t bytes[1 << 20];
    size_t size = fread(bytes, 1, sizeof bytes, file);
    (void)fclose(file);
    (void)LLVMFuzzerTestOneInput(bytes, size);
    for (unsigned i = 0; i < mutations && size > 0; i++) {
        uint8_t *copy = malloc(size);
        if (!copy) {
            return 1;
        }
        memcpy(copy, bytes, size);
        for (unsigned k = 0; k <= i % 3; k++) {
            copy[next() % size] = (uint8_t)next();
        }
        (void)LLVMFuzzerTestOneInput(copy, i % 5 == 4 ? (size_t)(next() % size) : size);
        free(copy);
    }
    return 0;
}

int main(int argc, char **argv)
{
    unsigned files = 0;
    int failed = 0;
    for (int i = 1; i < argc; i++) {
        DIR *folder = opendir(argv[i]);
        if (!folder) {
            (void)fprintf(stderr, "%s: not a folder\n", argv[i]);
            return 1;
        }
        for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
            char path[4096];
            if (entry->d_name[0] != '.' &&
                snprintf(path, sizeof path, "%s/%s", argv[i], entry->d_name) < (int)sizeof path) {
                failed |= replay_file(path, 2000);
                files++;
            }
        }
        (void)closedir(folder);
    }
    (void)printf("%u files replayed\n", files);
    return failed || files == 0;
}
