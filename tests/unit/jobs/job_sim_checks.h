/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_JOB_SIM_CHECKS_H
#define UMBRAGE_TESTS_JOB_SIM_CHECKS_H
/* Invariants of a simulated bake service, checked after each step. The test program includes this
 * file once. */
#include "job_simulation.h"
#include "jobs/folder.h"
#include "jobs/staging.h"

#define OWNERS       3
#define CONTENTS     8
#define WORKERS      3
#define SLOTS        (2 * WORKERS) /* tries that were ended may report late */
#define LEASE_MS     60000
#define OWNER_JOBS   6
#define ASSET_BYTES  100
#define OWNER_ASSETS (ASSET_BYTES * (CONTENTS - 3))
#define HOUR_MS      INT64_C(3600000)
#define LIVES        24
#define STEPS        60
#define END_STEPS    3000

static const char *const owner_names[OWNERS] = {"ann", "bob", "eve"};

/* A try that the executor was given. */
struct sim_try {
    int taken, ended_by_service, ended_by_owner;
    int is_doubtful; /* a sign of life may have been lost with a failing call */
    struct umbj_work work;
    unsigned content;
    int64_t sign_ms; /* last sign of life, steady */
};

struct sim {
    struct umbj_executor executor; /* first */
    struct sim_world *world;
    char folder[96], program[8];
    struct umbj_service *service;
    struct sim_try tries[SLOTS];
    int owner_cancels, is_sound;
    unsigned faults_before; /* this life */
};

static struct sim_job *known_job(struct sim_world *world, const char *id);

static int has_try(const struct sim *sim, const struct umbj_job *job)
{
    for (int i = 0; i < SLOTS; i++) {
        const struct sim_try *try = &sim->tries[i];
        if (try->taken && !try->ended_by_service && try->work.epoch == job->epoch &&
            strcmp(try->work.job, job->id) == 0) {
            return 1;
        }
    }
    return 0;
}

static int bundle_is_there(const struct sim *sim, const struct umbj_job *job)
{
    char path[4300], key[UMB_ID_TEXT_SIZE];
    umb_id_to_text(job->key, key);
    snprintf(path, sizeof path, "%s/bundles/%s", sim->folder, key);
    return access(path, F_OK) == 0;
}

static void check_job(struct sim *sim, const struct umbj_job *job, unsigned owner)
{
    char path[4300];
    int owned = 0;
    struct umb_error error;
    struct sim_job *seen = known_job(sim->world, job->id);
    CHECK(job->damage == NULL && strcmp(job->owner, owner_names[owner]) == 0);
    CHECK(job->tries <= UMBJ_TRIES_MAX && job->hard_tries <= UMBJ_HARD_TRIES_MAX);
    if (seen != NULL) {
        CHECK(seen->owner == owner);
        CHECK(!umbj_is_over(seen->state) || seen->state == job->state); /* the end is the end */
        CHECK(job->epoch >= seen->epoch && job->tries >= seen->tries);
        seen->state = job->state;
        seen->epoch = job->epoch;
        seen->tries = job->tries;
    }
    if (!umbj_is_over(job->state)) {
        CHECK(bundle_is_there(sim, job));
    }
    if (job->state == UMBJ_DONE) {
        CHECK(job->has_asset);
        CHECK(umbj_table_asset(sim->service->table, job->asset, job->owner, &owned, &error) ==
              UMB_OK);
        umbj_asset_path(sim->service->assets_path, job->asset, path, sizeof path);
        CHECK(!owned || sim->world->tampered || access(path, F_OK) == 0);
    }
}

static void add_owned(void *user, const uint8_t *asset, const char *owner)
{
    (void)asset;
    (void)owner;
    *(int64_t *)user += ASSET_BYTES;
}

static void check_counts(struct sim *sim, const int64_t states[UMBJ_STATE_COUNT])
{
    int64_t counted[UMBJ_STATE_COUNT], bytes = 0;
    struct umbj_kept kept;
    struct umb_error error;
    struct umbj_table *table = sim->service->table;
    CHECK(umbj_table_count(table, counted, &error) == UMB_OK);
    for (int i = 0; i < UMBJ_STATE_COUNT; i++) {
        CHECK(counted[i] == states[i]);
    }
    CHECK(umbj_table_owned(table, add_owned, &bytes, &error) == UMB_OK);
    CHECK(umbj_table_kept(table, NULL, &kept, &error) == UMB_OK);
    CHECK(kept.asset_bytes == bytes);
    CHECK(kept.jobs == states[UMBJ_DONE] + states[UMBJ_FAILED] + states[UMBJ_POISON]);
}

static size_t names_in(const char *folder, const char *name)
{
    char path[200];
    struct umbj_names names;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    int fd = open(path, O_RDONLY | O_DIRECTORY);
    CHECK(fd >= 0 && umbj_names_read(fd, &names) == 0);
    const size_t count = names.count;
    umbj_names_finish(&names);
    close(fd);
    return count;
}

/* Lists the keys of unfinished jobs, each once. */
struct keys {
    size_t count;
    uint8_t list[OWNERS * OWNER_JOBS][UMBJ_HASH_BYTES];
};

static void add_key(struct keys *keys, const uint8_t *key)
{
    size_t i = 0;
    while (i < keys->count && memcmp(keys->list[i], key, UMBJ_HASH_BYTES) != 0) {
        i++;
    }
    if (i == keys->count) {
        CHECK(i < OWNERS * OWNER_JOBS);
        memcpy(keys->list[keys->count++], key, UMBJ_HASH_BYTES);
    }
}

/* Returns how many jobs are unfinished. */
static int64_t check_all(struct sim *sim)
{
    int64_t states[UMBJ_STATE_COUNT] = {0}, found = 0;
    struct keys keys = {0};
    struct umb_error error;
    for (unsigned owner = 0; owner < OWNERS; owner++) {
        struct umbj_job *jobs = NULL;
        size_t count = 0;
        int64_t unfinished = 0;
        CHECK(umbj_service_list(sim->service, owner_names[owner], SIM_JOBS, &jobs, &count,
                                &error) == UMB_OK);
        for (size_t i = 0; i < count; i++) {
            check_job(sim, &jobs[i], owner);
            states[jobs[i].state]++;
            unfinished += !umbj_is_over(jobs[i].state);
            if (!umbj_is_over(jobs[i].state)) {
                add_key(&keys, jobs[i].key);
            }
            found += known_job(sim->world, jobs[i].id) != NULL;
            if (sim->is_sound && jobs[i].state == UMBJ_RUNNING) {
                CHECK(has_try(sim, &jobs[i]));
            }
        }
        CHECK(unfinished <= OWNER_JOBS);
        struct umbj_kept kept;
        CHECK(umbj_table_kept(sim->service->table, owner_names[owner], &kept, &error) == UMB_OK);
        CHECK(kept.asset_bytes <= OWNER_ASSETS);
        free(jobs);
    }
    CHECK(found == sim->world->job_count); /* nothing that was acknowledged is gone */
    check_counts(sim, states);
    if (sim->world->faults == sim->faults_before) { /* else one may not have gone */
        CHECK(names_in(sim->folder, "bundles") == keys.count);
    }
    return states[UMBJ_QUEUED] + states[UMBJ_RUNNING];
}

#endif
