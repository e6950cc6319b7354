/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Assimp's view of files (assimp_files.h). Assimp 5.2.5 passes URIs on unchanged.
 */
#include "bake/import/assimp_files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One open file. */
struct open_file {
    struct umbb_file file;
    int owned; /* unmap on close */
    size_t at;
};

static size_t read_proc(struct aiFile *handle, char *out, size_t size, size_t count)
{
    struct open_file *open = (struct open_file *)(void *)handle->UserData;
    if (size == 0 || count == 0) {
        return 0;
    }
    size_t left = (open->file.size - open->at) / size;
    count = count < left ? count : left;
    memcpy(out, open->file.bytes + open->at, count * size);
    open->at += count * size;
    return count;
}

static size_t write_proc(struct aiFile *handle, const char *bytes, size_t size, size_t count)
{
    (void)handle;
    (void)bytes;
    (void)size;
    (void)count;
    return 0;
}

static size_t tell_proc(struct aiFile *handle)
{
    return ((struct open_file *)(void *)handle->UserData)->at;
}

static size_t size_proc(struct aiFile *handle)
{
    return ((struct open_file *)(void *)handle->UserData)->file.size;
}

static enum aiReturn seek_proc(struct aiFile *handle, size_t offset, enum aiOrigin origin)
{
    struct open_file *open = (struct open_file *)(void *)handle->UserData;
    size_t base = origin == aiOrigin_CUR ? open->at : origin == aiOrigin_END ? open->file.size : 0;
    /* Assimp passes negative offsets as huge ones; unsigned addition wraps as intended. */
    size_t target = base + offset;
    if (target > open->file.size) {
        return aiReturn_FAILURE;
    }
    open->at = target;
    return aiReturn_SUCCESS;
}

static void flush_proc(struct aiFile *handle)
{
    (void)handle;
}

static enum umb_status find_file(struct umbb_assimp_files *files, const char *name,
                                 struct open_file *open, struct umb_error *error)
{
    const struct umbb_import *job = files->job;
    if (strcmp(name, files->main_name) == 0) {
        open->file = job->file;
        return UMB_OK;
    }
    const enum umb_status status = umbb_file_map_uri(&job->folder, name, strlen(name),
                                                     job->max_input_bytes, &open->file, error);
    open->owned = status == UMB_OK;
    return status;
}

static struct aiFile *open_proc(struct aiFileIO *io, const char *name, const char *mode)
{
    struct umbb_assimp_files *files = (struct umbb_assimp_files *)(void *)io->UserData;
    if (strpbrk(mode, "wa+") != NULL) {
        return NULL;
    }
    struct umb_error error = {0};
    struct open_file *open = calloc(1, sizeof(*open));
    struct aiFile *handle = calloc(1, sizeof(*handle));
    if (open == NULL || handle == NULL || find_file(files, name, open, &error) != UMB_OK) {
        (void)snprintf(files->refused, sizeof(files->refused), "%.150s", error.message);
        free(open);
        free(handle);
        return NULL;
    }
    handle->ReadProc = read_proc;
    handle->WriteProc = write_proc;
    handle->TellProc = tell_proc;
    handle->FileSizeProc = size_proc;
    handle->SeekProc = seek_proc;
    handle->FlushProc = flush_proc;
    handle->UserData = (char *)open;
    return handle;
}

static void close_proc(struct aiFileIO *io, struct aiFile *handle)
{
    (void)io;
    struct open_file *open = (struct open_file *)(void *)handle->UserData;
    if (open->owned) {
        umbb_file_unmap(&open->file);
    }
    free(open);
    free(handle);
}

void umbb_assimp_files_init(struct umbb_assimp_files *files, const struct umbb_import *job,
                            const char *main_name)
{
    memset(files, 0, sizeof(*files));
    files->job = job;
    files->main_name = main_name;
    files->io.OpenProc = open_proc;
    files->io.CloseProc = close_proc;
    files->io.UserData = (char *)files;
}
