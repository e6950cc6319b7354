/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The bake service in a simulated world. Table, service, leases and files are the daemon's; clocks,
 * executor, owners, failing calls and the moments of death are drawn from a seed. There is one
 * thread, so that a seed always gives the same run. Each life is a process; the next life must find
 * everything that was acknowledged before its death.
 */
#define _GNU_SOURCE /* MAP_ANONYMOUS, syscall */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <cmocka.h>

#include "common/sha256.h"
#include "job_sim_checks.h"
#include "jobs/folder.h"
#include "jobs/staging.h"
#include "make_asset.h"

/* --- the executor --- */

static int live_tries(const struct sim *sim)
{
    int count = 0;
    for (int i = 0; i < SLOTS; i++) {
        count += sim->tries[i].taken && !sim->tries[i].ended_by_service;
    }
    return count;
}

static unsigned content_of(const struct sim *sim, const char *job)
{
    for (unsigned i = 0; i < sim->world->job_count; i++) {
        if (strcmp(sim->world->jobs[i].id, job) == 0) {
            return sim->world->jobs[i].content;
        }
    }
    return CONTENTS; /* its submission was never answered: the scene tells */
}

static enum umb_status sim_start(struct umbj_executor *self, const struct umbj_work *work,
                                 struct umb_error *error)
{
    struct sim *sim = (struct sim *)self;
    struct stat info;
    char scene[4300];
    unsigned number = 0;
    if (!sim->is_sound && draw(sim->world, 20) == 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "worker: no thread to be had");
    }
    CHECK(sscanf(work->scene, "%u.obj", &number) == 1);
    snprintf(scene, sizeof scene, "%s/%s", work->bundle, work->scene);
    CHECK(stat(scene, &info) == 0 && info.st_size == 8); /* whole, as it was sent */
    CHECK(strcmp(work->settings, "--resolution=64\n") == 0);
    int free_slot = -1;
    for (int i = 0; i < SLOTS; i++) {
        const struct sim_try *try = &sim->tries[i];
        CHECK(!try->taken || try->ended_by_service || strcmp(try->work.job, work->job) != 0);
        free_slot = try->taken ? free_slot : i;
    }
    CHECK(free_slot >= 0 && live_tries(sim) < WORKERS);
    const unsigned content = content_of(sim, work->job);
    sim->tries[free_slot] = (struct sim_try){.taken = 1,
                                             .work = *work,
                                             .content = content < CONTENTS ? content : number,
                                             .sign_ms = sim->world->steady_ms};
    return UMB_OK;
}

/* Checks a lease that is over: no try may lose its job if it gave a sign of life in time. */
static void sim_cancel(struct umbj_executor *self, const char *job, int64_t epoch)
{
    struct sim *sim = (struct sim *)self;
    for (int i = 0; i < SLOTS; i++) {
        struct sim_try *try = &sim->tries[i];
        if (try->taken && try->work.epoch == epoch && strcmp(try->work.job, job) == 0) {
            CHECK(sim->owner_cancels || try->is_doubtful ||
                  sim->world->steady_ms - try->sign_ms > LEASE_MS - LEASE_MS / 4);
            sim->world->lost += !sim->owner_cancels && !try->ended_by_service;
            try->ended_by_service = 1;
        }
    }
}

static int sim_free_slots(struct umbj_executor *self)
{
    const struct sim *sim = (struct sim *)self;
    int taken = 0;
    for (int i = 0; i < SLOTS; i++) {
        taken += sim->tries[i].taken;
    }
    const int live = live_tries(sim);
    return taken == SLOTS || live >= WORKERS ? 0 : 1;
}

static void sim_destroy(struct umbj_executor *self)
{
    memset(((struct sim *)self)->tries, 0, sizeof((struct sim *)self)->tries);
}

/* --- a life --- */

static int64_t world_unix_ms(void *user)
{
    return ((struct sim_world *)user)->unix_ms;
}

static int64_t world_steady_ms(void *user)
{
    return ((struct sim_world *)user)->steady_ms;
}

/* The daemon's store: it loads new assets after a while, and some never. */
static int world_serves(void *user, const uint8_t *asset)
{
    struct sim *sim = user;
    (void)asset;
    if (sim->is_sound) {
        return 1;
    }
    return draw(sim->world, 40) == 0 ? -1 : draw(sim->world, 3) == 0;
}

static void world_replaces(void *user, const uint8_t *asset, int yes)
{
    CHECK(user != NULL && asset != NULL && (yes == 0 || yes == 1));
}

static void world_kicked(void *user)
{
    CHECK(user != NULL);
}

static void open_service(struct sim *sim)
{
    static const struct umbs_log *const no_log;
    const struct umbj_clocks clocks = {world_unix_ms, world_steady_ms, sim->world};
    const struct umbj_service_options options = {
        .folder = sim->folder,
        .tries.program = "/bin/true",
        .tries.workers = WORKERS,
        .tries.threads = 1,
        .tries.max_output_bytes = 1000,
        .max_bundle_bytes = 1000,
        .keep_ms = (uint64_t)1 << 50,
        .limits = {.owner_jobs = OWNER_JOBS,
                   .owner_bytes = 1000,
                   .total_bytes = 4000,
                   .lease_ms = LEASE_MS,
                   .owner_assets = OWNER_ASSETS},
        .tries.cache_bytes = 1000,
        .log = no_log,
        .store_changed = world_kicked,
        .replacing = world_replaces,
        .is_served = world_serves,
        .user = sim,
        .clocks = &clocks,
        .executor = &sim->executor,
    };
    struct umb_error error = {0};
    sim->executor = (struct umbj_executor){sim_start, sim_cancel, sim_free_slots, sim_destroy};
    const enum umb_status status = umbj__service_open(&options, &sim->service, &error);
    if (status != UMB_OK) {
        CHECK(!sim->is_sound);
        sim_exit(0); /* a call failed: an operator would start it again */
    }
}

static void begin_life(struct sim *sim, struct sim_world *world, const char *folder, int is_sound)
{
    memset(sim, 0, sizeof *sim);
    sim->world = world;
    sim->is_sound = is_sound;
    snprintf(sim->folder, sizeof sim->folder, "%s", folder);
    world->calls_to_death = is_sound || draw(world, 4) == 0 ? -1 : (int64_t)draw(world, 1500);
    world->calls_to_fault = -1;
    sim->faults_before = world->faults;
    gate_world = world;
    gate_is_watching = 1;
    open_service(sim);
}

static struct sim_job *known_job(struct sim_world *world, const char *id)
{
    for (unsigned i = 0; i < world->job_count; i++) {
        if (strcmp(world->jobs[i].id, id) == 0) {
            return &world->jobs[i];
        }
    }
    return NULL;
}

static void learn(struct sim_world *world, const char *id, unsigned owner, unsigned content)
{
    if (known_job(world, id) == NULL) {
        CHECK(world->job_count < SIM_JOBS);
        struct sim_job *job = &world->jobs[world->job_count];
        *job = (struct sim_job){.owner = owner, .content = content};
        memcpy(job->id, id, sizeof job->id);
        world->job_count++; /* last: a death between finds it whole or not at all */
    }
}

/* --- what owners do --- */

static void manifest_of(unsigned content, struct umbj_manifest *manifest,
                        struct umbj_bundle_file *file, char text[16])
{
    static const struct umbj_setting setting = {"resolution", "64"};
    static char path[16];
    snprintf(path, sizeof path, "%u.obj", content);
    snprintf(text, 16, "v %u 0 0\n", content);
    *file = (struct umbj_bundle_file){.path = path, .size = 8};
    umbs_sha256_bytes(text, 8, file->sha256);
    *manifest = (struct umbj_manifest){
        .scene = path, .files = file, .file_count = 1, .settings = &setting, .setting_count = 1};
}

/* Called between the steps of a submission: jobs of the same scene end, and no longer need its
 * bundle. */
static void end_twins(struct sim *sim, unsigned content)
{
    struct umbj_job job;
    struct umb_error error;
    for (unsigned i = 0; i < sim->world->job_count; i++) {
        const struct sim_job *twin = &sim->world->jobs[i];
        if (twin->content == content && !umbj_is_over(twin->state)) {
            sim->owner_cancels = 1;
            (void)!umbj_service_cancel(sim->service, twin->id, owner_names[twin->owner], &job,
                                       &error);
            sim->owner_cancels = 0;
        }
    }
}

static void submit(struct sim *sim)
{
    struct sim_world *world = sim->world;
    const unsigned owner = draw(world, OWNERS), content = draw(world, CONTENTS);
    struct umbj_manifest manifest;
    struct umbj_bundle_file file;
    struct umbj_prepared prepared;
    struct umbj_upload *upload = NULL;
    struct umbj_job job = {0};
    struct umb_error error;
    char text[16];
    manifest_of(content, &manifest, &file, text);
    CHECK(umbj_manifest_prepare(&manifest, 1000, &prepared, &error) == UMB_OK);
    enum umb_status status = umbj_service_submit(sim->service, owner_names[owner], &manifest,
                                                 &prepared, &job, &upload, &error);
    const int is_interrupted = draw(world, 10) == 0; /* the client is gone */
    if (status == UMB_OK && upload != NULL && !is_interrupted) {
        status = umbj_upload_write(upload, text, 8, &error);
        if (status == UMB_OK) {
            status = umbj_upload_accept(upload, &error);
        }
        if (draw(world, 3) == 0) {
            end_twins(sim, content);
            umbj__service_turn(sim->service, 0);
        }
        if (status == UMB_OK && draw(world, 10) != 0) { /* else the client is gone now */
            status = umbj_service_accept(sim->service, owner_names[owner], &manifest, &prepared,
                                         upload, &job, &error);
        }
    }
    umbj_upload_discard(upload);
    umbj_service_drop_upload(sim->service, upload);
    world->refused += status == UMB_E_BUSY;
    if (status == UMB_OK && job.id[0] != '\0' && draw(world, 8) != 0) { /* else the reply is lost */
        learn(world, job.id, owner, content);
    }
}

static void cancel(struct sim *sim)
{
    struct sim_world *world = sim->world;
    struct umbj_job job;
    struct umb_error error;
    if (world->job_count > 0) {
        const struct sim_job *chosen = &world->jobs[draw(world, world->job_count)];
        sim->owner_cancels = 1;
        world->cancelled += umbj_service_cancel(sim->service, chosen->id,
                                                owner_names[chosen->owner], &job, &error) == UMB_OK;
        CHECK(umbj_service_cancel(sim->service, chosen->id,
                                  owner_names[(chosen->owner + 1) % OWNERS], &job,
                                  &error) != UMB_OK);
        sim->owner_cancels = 0;
    }
}

static void asset_of(unsigned content, uint8_t asset[UMBJ_HASH_BYTES])
{
    umbs_sha256_bytes(&content, sizeof content, asset);
}

static void delete_asset(struct sim *sim)
{
    uint8_t asset[UMBJ_HASH_BYTES];
    struct umb_error error;
    asset_of(draw(sim->world, CONTENTS), asset);
    const char *owner = draw(sim->world, 8) == 0 ? NULL : owner_names[draw(sim->world, OWNERS)];
    (void)!umbj_service_delete(sim->service, asset, owner, &error);
}

/* An owner fetches an asset: the result must be its bytes or a refusal, never another owner's. */
static void fetch(struct sim *sim)
{
    const unsigned content = draw(sim->world, CONTENTS);
    const char *owner = owner_names[draw(sim->world, OWNERS)];
    uint8_t asset[UMBJ_HASH_BYTES], byte = 0;
    int fd = -1, owned = 0;
    uint64_t bytes = 0;
    struct umb_error error;
    asset_of(content, asset);
    if (umbj_service_open_asset(sim->service, asset, owner, &fd, &bytes, &error) == UMB_OK) {
        CHECK(bytes == ASSET_BYTES && read(fd, &byte, 1) == 1 && byte == content);
        close(fd);
        CHECK(umbj_table_asset(sim->service->table, asset, owner, &owned, &error) != UMB_OK ||
              owned);
    }
}

static void take_standing(void *user, const struct umbj_standing *standing)
{
    struct sim *sim = user;
    CHECK(standing->done <= standing->total || standing->total == 0);
    CHECK(standing->tiles.done <= standing->tiles.total);
    CHECK(standing->plan != NULL || standing->job.id[0] != '\0');
    CHECK(sim->world != NULL);
}

/* A watcher comes, or comes back. */
static void watch(struct sim *sim)
{
    struct sim_world *world = sim->world;
    struct umb_error error;
    struct umbj_snapshot *snapshot = umbj_service_snapshot(sim->service);
    if (world->job_count == 0) {
        return;
    }
    const struct sim_job *job = &world->jobs[draw(world, world->job_count)];
    const char *other = owner_names[(job->owner + 1) % OWNERS];
    if (umbj_service_show(sim->service, job->id, owner_names[job->owner], &error) == UMB_OK) {
        CHECK(umbj_snapshot_version(snapshot, job->id) > 0);
        CHECK(umbj_snapshot_look(snapshot, job->id, owner_names[job->owner], take_standing, sim));
        CHECK(umbj_snapshot_look(snapshot, job->id, NULL, take_standing, sim));
    }
    CHECK(!umbj_snapshot_look(snapshot, job->id, other, take_standing, sim));
    CHECK(umbj_service_show(sim->service, job->id, other, &error) != UMB_OK);
    const struct umbj_tiles tiles = umbj_snapshot_tiles(snapshot);
    CHECK(tiles.done <= tiles.total);
}

/* An operator removes the file of an asset, which operators should not do. */
static void remove_file(struct sim *sim)
{
    uint8_t asset[UMBJ_HASH_BYTES];
    char path[4300];
    if (draw(sim->world, 4) == 0) {
        asset_of(draw(sim->world, CONTENTS), asset);
        umbj_asset_path(sim->service->assets_path, asset, path, sizeof path);
        (void)syscall(SYS_unlinkat, AT_FDCWD, path, 0);
        sim->world->tampered = 1;
    }
}

/* --- what tries do --- */

static struct umbj_report report_of(const struct sim_try *try, enum umbj_report_kind kind)
{
    struct umbj_report report = {.kind = kind, .epoch = try->work.epoch, .staged = {.fd = -1}};
    memcpy(report.job, try->work.job, sizeof report.job);
    snprintf(report.text, sizeof report.text, "bake");
    return report;
}

/* Leaves a bake's result beside its final place; a call may fail. */
static enum umb_status stage(struct sim *sim, const struct sim_try *try, struct umbj_report *report)
{
    char path[4300], content[ASSET_BYTES];
    struct umb_error error;
    asset_of(try->content, report->asset);
    memset(content, (int)try->content, sizeof content);
    umbj_asset_path(sim->service->assets_path, report->asset, path, sizeof path);
    enum umb_status status = umbu_output_begin(path, 0, &report->staged, &error);
    if (status == UMB_OK) {
        status = umbu_output_write(&report->staged, content, sizeof content, &error);
    }
    if (status != UMB_OK) {
        umbu_output_abandon(&report->staged);
        report->staged = (struct umbu_output){.fd = -1};
    }
    return status;
}

static void end_try(struct sim *sim, struct sim_try *try)
{
    static const enum umbj_failure failures[] = {UMBJ_REJECTED, UMBJ_TEMPORARY, UMBJ_IO,
                                                 UMBJ_CRASH,    UMBJ_MEMORY,    UMBJ_TIMEOUT,
                                                 UMBJ_INTERNAL, UMBJ_SANDBOX};
    struct umbj_report report = report_of(try, UMBJ_REPORT_ENDED);
    report.bake_ms = 5;
    if (try->work.is_known) {
        memcpy(report.asset, try->work.known_asset, sizeof report.asset);
    } else if (!sim->is_sound && draw(sim->world, 3) == 0) {
        report.failure = failures[draw(sim->world, sizeof failures / sizeof failures[0])];
    } else if (stage(sim, try, &report) != UMB_OK) {
        report.failure = UMBJ_IO;
    }
    sim->world->late += try->ended_by_service != 0;
    sim->world->done += report.failure == UMBJ_NO_FAILURE;
    try->taken = 0; /* as the executor: the slot is free before the report */
    umbj__take_report(sim->service, &report);
}

static void give_sign(struct sim *sim, struct sim_try *try)
{
    struct umbj_report report =
        report_of(try, (enum umbj_report_kind)draw(sim->world, UMBJ_REPORT_ENDED));
    const unsigned faults = sim->world->faults;
    report.total = 10;
    report.done = draw(sim->world, 11);
    report.found = draw(sim->world, (unsigned)report.done + 1);
    report.failure = UMBJ_LOST; /* of a task */
    umbj__take_report(sim->service, &report);
    try->is_doubtful = faults != sim->world->faults;
    try->sign_ms = sim->world->steady_ms;
}

static void work_on(struct sim *sim)
{
    struct sim_try *try = &sim->tries[draw(sim->world, SLOTS)];
    if (try->taken && (draw(sim->world, 3) == 0 || (sim->is_sound && draw(sim->world, 2)))) {
        end_try(sim, try);
    } else if (try->taken && !try->ended_by_service) {
        give_sign(sim, try);
    }
}

/* Advances time; all live tries report as often as bakes do, except one that may be silent. */
static void pass_time(struct sim *sim)
{
    struct sim_world *world = sim->world;
    const int silent = draw(world, 4) == 0 ? (int)draw(world, SLOTS) : -1;
    const unsigned hops = draw(world, 8);
    for (unsigned i = 0; i < hops; i++) {
        const int64_t passed = draw(world, LEASE_MS / 4);
        world->steady_ms += passed;
        world->unix_ms += passed;
        for (int t = 0; t < SLOTS; t++) {
            if (t != silent && sim->tries[t].taken && !sim->tries[t].ended_by_service) {
                give_sign(sim, &sim->tries[t]);
            }
        }
        umbj__service_turn(sim->service, 0);
    }
}

static void step_clock(struct sim *sim)
{
    static const int64_t steps[] = {HOUR_MS / 3, -HOUR_MS, HOUR_MS * 24, -HOUR_MS / 60};
    sim->world->unix_ms += steps[draw(sim->world, 4)];
    sim->world->stepped++;
}

static void break_something(struct sim *sim)
{
    static const int errors[] = {EIO, ENOSPC, EMFILE, EINTR};
    sim->world->fault = errors[draw(sim->world, 3)];
    sim->world->calls_to_fault = draw(sim->world, 40);
}

static void take_step(struct sim *sim)
{
    typedef void (*step_fn)(struct sim *);
    static const step_fn steps[] = {
        submit,     submit,          submit,       work_on,   work_on, work_on, work_on,
        cancel,     pass_time,       delete_asset, pass_time, work_on, submit,  work_on,
        step_clock, break_something, fetch,        watch,     fetch,   watch,   remove_file};
    steps[draw(sim->world, sizeof steps / sizeof steps[0])](sim);
    umbj__service_turn(sim->service, 0);
    if (sim->world->calls_to_fault < 0) {
        gate_is_watching = 0;
        (void)check_all(sim);
        gate_is_watching = 1;
    }
}

static _Noreturn void live(struct sim_world *world, const char *folder)
{
    static struct sim sim;
    begin_life(&sim, world, folder, 0);
    for (int i = 0; i < STEPS; i++) {
        take_step(&sim);
    }
    umbj_service_destroy(sim.service);
    sim_exit(0);
}

/* The last life: no call fails any more, and every job must come to its end. */
static _Noreturn void finish(struct sim_world *world, const char *folder)
{
    static struct sim sim;
    int64_t unfinished = 1;
    begin_life(&sim, world, folder, 1);
    for (int i = 0; i < END_STEPS && unfinished > 0; i++) {
        work_on(&sim);
        pass_time(&sim);
        unfinished = check_all(&sim);
    }
    CHECK(unfinished == 0);
    CHECK(names_in(folder, "bundles") == 0);
    umbj_service_destroy(sim.service);
    begin_life(&sim, world, folder, 1); /* sweeps what removals left at the end */
    CHECK(names_in(folder, "incoming") == 0 && names_in(folder, "work") == 0);
    (void)check_all(&sim);
    umbj_service_destroy(sim.service);
    sim_exit(0);
}

/* Runs a life in a process of its own; returns its exit code. */
static int in_child(void (*run)(struct sim_world *, const char *), struct sim_world *world,
                    const char *folder)
{
    int status = 0;
    fflush(NULL);
    const pid_t child = fork();
    if (child == 0) {
        run(world, folder);
    }
    assert_true(child > 0);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void simulate(uint64_t seed, struct sim_world *sum)
{
    char folder[64] = "/tmp/umbrage-sim-XXXXXX";
    struct sim_world *world =
        mmap(NULL, sizeof *world, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_true(world != MAP_FAILED);
    assert_non_null(mkdtemp(folder));
    *world =
        (struct sim_world){.random = seed, .steady_ms = 1000000, .unix_ms = INT64_C(1700000000000)};
    for (int i = 0; i <= LIVES; i++) {
        const int code = in_child(i < LIVES ? live : finish, world, folder);
        if (code != 0 && (code != SIM_DIED || i == LIVES)) {
            fail_msg("seed %llu, life %d ended with %d", (unsigned long long)seed, i, code);
        }
    }
    sum->job_count += world->job_count;
    sum->done += world->done;
    sum->lost += world->lost;
    sum->deaths += world->deaths;
    sum->faults += world->faults;
    sum->late += world->late;
    sum->cancelled += world->cancelled;
    sum->refused += world->refused;
    sum->stepped += world->stepped;
    umbj_folder_remove(-1, folder);
    munmap(world, sizeof *world);
}

static void whatever_happens_no_job_is_lost_and_none_is_run_twice(void **state)
{
    struct sim_world sum = {0};
    const char *cases = getenv("UMBRAGE_CASES");
    const unsigned count =
        cases != NULL ? (unsigned)strtoul(cases, NULL, 10) : (unsigned)short_count(6, 1);
    const char *first = getenv("UMBRAGE_SEED");
    const uint64_t from = first != NULL ? strtoull(first, NULL, 10) : 1;
    (void)state;
    for (uint64_t seed = from; seed < from + count; seed++) {
        simulate(seed, &sum);
    }
    print_message("%u worlds: %u jobs, %u bakes, %u leases over, %u reports too late, %u cancelled,"
                  " %u refused, %u clocks set, %u calls failed, %u deaths\n",
                  count, sum.job_count, sum.done, sum.lost, sum.late, sum.cancelled, sum.refused,
                  sum.stepped, sum.faults, sum.deaths);
    if (count >= 6) { /* each of them did happen */
        assert_true(sum.job_count > 100 && sum.done > 100 && sum.lost > 5 && sum.late > 10);
        assert_true(sum.cancelled > 10 && sum.refused > 2 && sum.stepped > 10);
        assert_true(sum.faults > 50 && sum.deaths > 20);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(whatever_happens_no_job_is_lost_and_none_is_run_twice),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
