/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Opens the job service on one folder after another as a daemon does, recovery included, without a
 * worker, and prints the jobs. For test_power_cuts.py.
 *
 *     open_jobs UMBRAGE-BAKE <names of folders, one a line
 *
 * Prints for each "job ID STATE ASSET" lines ("-" = none) and then "end ok" or "end REASON".
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "jobs/service.h"
#include "umbrage/asset.h"

#define MOST_JOBS 1000

struct listing {
    struct umbj_request request;
    struct umb_error error;
    enum umb_status status;
    int is_done;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
};

static void print_jobs(struct umbj_request *request, struct umbj_service *service)
{
    struct listing *listing = (struct listing *)request;
    struct umbj_job *jobs = NULL;
    size_t count = 0;
    listing->status = umbj_service_list(service, NULL, MOST_JOBS, &jobs, &count, &listing->error);
    for (size_t i = 0; i < count; i++) {
        char asset[UMB_ID_TEXT_SIZE] = "-";
        if (jobs[i].has_asset) {
            umb_id_to_text(jobs[i].asset, asset);
        }
        (void)printf("job %s %s %s\n", jobs[i].id, umbj_state_name(jobs[i].state), asset);
    }
    free(jobs);
}

static void end(struct umbj_request *request)
{
    struct listing *listing = (struct listing *)request;
    pthread_mutex_lock(&listing->mutex);
    listing->is_done = 1;
    pthread_cond_signal(&listing->wake);
    pthread_mutex_unlock(&listing->mutex);
}

static enum umb_status list(struct umbj_service *service, struct umb_error *error)
{
    struct listing listing = {.request = {.run = print_jobs, .done = end},
                              .mutex = PTHREAD_MUTEX_INITIALIZER,
                              .wake = PTHREAD_COND_INITIALIZER};
    umbj_service_post(service, &listing.request);
    pthread_mutex_lock(&listing.mutex);
    while (!listing.is_done) {
        pthread_cond_wait(&listing.wake, &listing.mutex);
    }
    pthread_mutex_unlock(&listing.mutex);
    *error = listing.error;
    return listing.status;
}

static enum umb_status open_folder(const char *folder, const char *program, struct umb_error *error)
{
    struct umbj_service *service = NULL;
    const struct umbj_service_options options = {
        .folder = folder,
        .tries.program = program,
        .tries.max_output_bytes = 1 << 30,
        .max_bundle_bytes = 1 << 30,
        .keep_ms = (uint64_t)1 << 40,
        .limits = {.owner_jobs = 1000,
                   .owner_bytes = 1 << 30,
                   .total_bytes = 1 << 30,
                   .lease_ms = 60000},
    };
    enum umb_status status = umbj_service_create(&options, &service, error);
    if (status == UMB_OK) {
        status = list(service, error);
        umbj_service_destroy(service);
    }
    return status;
}

int main(int argc, char **argv)
{
    char folder[4096];
    if (argc != 2) {
        (void)fprintf(stderr, "usage: open_jobs UMBRAGE-BAKE <FOLDERS\n");
        return 64;
    }
    while (fgets(folder, sizeof folder, stdin) != NULL) {
        struct umb_error error = {0};
        folder[strcspn(folder, "\n")] = '\0';
        const enum umb_status status = open_folder(folder, argv[1], &error);
        (void)printf("end %s\n", status == UMB_OK ? "ok" : error.message);
        (void)fflush(stdout);
    }
    return 0;
}
