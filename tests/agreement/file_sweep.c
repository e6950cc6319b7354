/* SPDX-License-Identifier: Apache-2.0 */
/*
 * file_sweep FILE...: an asset's reader must refuse every prefix of the file, and the file with any
 * single bit flipped. Each is read from a block of exactly its size. Exit code 1: one was accepted;
 * the program stops there.
 *
 * Every byte of a packed file is checked, and every byte of a mapped one, also the zeros between
 * its sections. The sanitizer build shows that nothing is read beyond a prefix's end.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umbrage/asset.h"

#define ALIGNMENT 64 /* of mapped files in memory */

/* Reads a whole file; NULL if it cannot be read. */
static uint8_t *read_all(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    uint8_t *bytes = NULL;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0) {
        const long length = ftell(file);
        *size = length > 0 ? (size_t)length : 0;
        bytes = malloc(*size + 1);
        rewind(file);
        if (bytes != NULL && fread(bytes, 1, *size, file) != *size) {
            free(bytes);
            bytes = NULL;
        }
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return bytes;
}

static enum umb_status try_open(const uint8_t *bytes, size_t size)
{
    struct umb_asset *asset;
    struct umb_error error;
    const enum umb_status status = umb_asset_open_bytes(bytes, size, NULL, &asset, &error);
    if (status == UMB_OK) {
        umb_asset_close(asset);
    }
    return status;
}

/* Opens every prefix of the file, placed at the end of a block. Returns how many were accepted. */
static size_t sweep_prefixes(const uint8_t *bytes, size_t size)
{
    size_t taken = 0;
    for (size_t length = 0; length < size; length++) {
        void *block;
        if (posix_memalign(&block, ALIGNMENT, length > 0 ? length : 1) != 0) {
            return SIZE_MAX;
        }
        memcpy(block, bytes, length);
        if (try_open(block, length) == UMB_OK) {
            printf("  a prefix of %zu bytes is taken\n", length);
            taken++;
        }
        free(block);
    }
    return taken;
}

/* Opens the file with each bit flipped in turn, in a block of the file's size. */
static size_t sweep_bits(uint8_t *bytes, size_t size)
{
    size_t taken = 0;
    for (size_t bit = 0; bit < size * 8; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        if (try_open(bytes, size) == UMB_OK) {
            printf("  bit %zu of byte %zu may be flipped\n", bit % 8, bit / 8);
            taken++;
        }
        bytes[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    }
    return taken;
}

/* Returns 1 if everything was refused but the file itself. */
static int sweep(const char *path)
{
    size_t size = 0;
    uint8_t *bytes = read_all(path, &size);
    void *block = NULL;
    int good = 0;
    if (bytes == NULL || posix_memalign(&block, ALIGNMENT, size + 1) != 0) {
        (void)fprintf(stderr, "file_sweep: cannot read %s\n", path);
    } else {
        memcpy(block, bytes, size);
        good = try_open(block, size) == UMB_OK;
        if (!good) {
            printf("%s does not open\n", path);
        }
        good = good && sweep_prefixes(bytes, size) == 0 && sweep_bits(block, size) == 0;
        printf("%s: %zu prefixes and %zu bits %s\n", path, size, size * 8,
               good ? "are refused" : "are not all refused");
    }
    free(bytes);
    free(block);
    return good;
}

int main(int argc, char **argv)
{
    int good = 1;
    for (int i = 1; i < argc; i++) {
        good &= sweep(argv[i]);
        (void)fflush(stdout);
    }
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
