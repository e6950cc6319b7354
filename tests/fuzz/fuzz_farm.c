/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Untrusted input of the job service besides calls: rows of jobs.db that another program wrote, and
 * lines of Slurm's squeue. The first byte selects the kind. Slurm's reader is part of this
 * program, so that lines can be fed without a process.
 */
#define _XOPEN_SOURCE 700
#include "../../server/jobs/slurm_farm.c"

#include <sqlite3.h>

#include "fuzz.h"
#include "fuzz_folder.h"
#include "jobs/job_table.h"

#define TASKS 8

static const char job_id[] = "0123456789abcdef0123456789abcdef";
static const char owner[] = "ann";
static const uint8_t sound_key[UMBJ_HASH_BYTES] = {1, 2, 3};

/* ---- rows ---- */

static struct umbj_table *table;
static sqlite3 *side; /* the other hand */

static void run(const char *text)
{
    char *why = NULL;
    if (sqlite3_exec(side, text, NULL, NULL, &why) != SQLITE_OK) {
        (void)fprintf(stderr, "%s: %s\n", text, why);
        abort();
    }
}

static void open_table(void)
{
    static const struct umbj_limits limits = {
        .owner_jobs = 100, .owner_bytes = 1 << 30, .total_bytes = 1 << 30, .lease_ms = 60000};
    char path[400];
    struct umb_error error;
    if (table == NULL) {
        (void)snprintf(path, sizeof path, "%s/jobs.db", fuzz_folder());
        FUZZ_DEMAND(umbj_table_open(path, &limits, &table, &error) == UMB_OK);
        FUZZ_DEMAND(sqlite3_open(path, &side) == SQLITE_OK);
        run("PRAGMA synchronous=OFF");
    }
}

/* A valid job; the input replaces one of its columns. */
static void submit_sound(void)
{
    const struct umbj_submission submission = {.owner = owner,
                                               .key = sound_key,
                                               .scene = "city.glb",
                                               .settings = "--resolution=256\n",
                                               .bundle_bytes = 100};
    struct umbj_job job;
    struct umb_error error;
    int is_new = 0;
    run("DELETE FROM job");
    run("DELETE FROM owned");
    FUZZ_DEMAND(umbj_table_submit(table, &submission, 1000, &job, &is_new, &error) == UMB_OK);
    run("UPDATE job SET id = '0123456789abcdef0123456789abcdef'");
}

static const char *const columns[] = {"settings", "scene", "id",    "owner", "cause",
                                      "state",    "key",   "asset", "epoch", "failure"};

/* Stores the input as text, blob or number. SQLite accepts any of them in any column, except where
 * a CHECK refuses. */
static int put(unsigned column, unsigned how, const uint8_t *bytes, size_t size)
{
    sqlite3_stmt *statement = NULL;
    char text[100];
    int64_t number = 0;
    memcpy(&number, bytes, size < sizeof number ? size : sizeof number);
    (void)snprintf(text, sizeof text, "UPDATE job SET %s = ?", columns[column]);
    FUZZ_DEMAND(sqlite3_prepare_v2(side, text, -1, &statement, NULL) == SQLITE_OK);
    if (how == 0) {
        (void)sqlite3_bind_text(statement, 1, (const char *)bytes, (int)size, SQLITE_TRANSIENT);
    } else if (how == 1) {
        (void)sqlite3_bind_blob(statement, 1, bytes, (int)size, SQLITE_TRANSIENT);
    } else {
        (void)sqlite3_bind_int64(statement, 1, number);
    }
    const int done = sqlite3_step(statement) == SQLITE_DONE;
    (void)sqlite3_finalize(statement);
    return done;
}

/* The settings of a row become words of a command line: each word must be one of the settings'
 * lines. */
static void check_settings(const char *settings)
{
    const size_t length = strlen(settings);
    char *exact = malloc(length + 1); /* so that a read behind the NUL is a read outside */
    struct umbj_words words = {0};
    FUZZ_DEMAND(exact != NULL);
    memcpy(exact, settings, length + 1);
    (void)umbj_settings_have(exact, "--closed=on");
    FUZZ_DEMAND(umbj_tile_edge(exact, 4096) <= 4096);
    umbj_words_add_settings(&words, exact, 4096);
    for (size_t i = 0; i + 1 < words.count; i++) { /* the last is --tile */
        FUZZ_DEMAND(strstr(exact, words.list[i]) != NULL);
        FUZZ_DEMAND(strchr(words.list[i], '\n') == NULL);
    }
    umbj_words_finish(&words);
    free(exact);
}

static void read_all(void)
{
    char scene[UMBJ_SCENE_SIZE], settings[UMBJ_SETTINGS_SIZE];
    struct umbj_job job, *jobs = NULL;
    struct umb_error error;
    int64_t counts[UMBJ_STATE_COUNT], number = 0;
    size_t count = 0;
    if (umbj_table_list(table, NULL, 100, &jobs, &count, &error) == UMB_OK) {
        for (size_t i = 0; i < count; i++) {
            FUZZ_DEMAND(umbj_state_name(jobs[i].state) != NULL);
            FUZZ_DEMAND(umbj_failure_name(jobs[i].failure) != NULL);
            FUZZ_DEMAND(strlen(jobs[i].id) < sizeof jobs[i].id);
            FUZZ_DEMAND(strlen(jobs[i].cause) < sizeof jobs[i].cause);
        }
    }
    free(jobs);
    (void)!umbj_table_count(table, counts, &error);
    (void)!umbj_table_get(table, job_id, owner, &job, &error);
    if (umbj_table_spec(table, job_id, scene, settings, &error) == UMB_OK) {
        FUZZ_DEMAND(strlen(scene) < sizeof scene);
        check_settings(settings);
    }
    if (umbj_table_find_same(table, owner, sound_key, &job, &error) == UMB_OK) {
        FUZZ_DEMAND(strcmp(job.owner, owner) == 0);
    }
    (void)!umbj_table_recover(table, 2000, &number, &error);
    (void)!umbj_table_prune(table, INT64_MAX, &error);
}

static void rows(const uint8_t *data, size_t size)
{
    if (size < 2 || size > 16384) {
        return;
    }
    open_table();
    submit_sound();
    if (put(data[0] % (sizeof columns / sizeof columns[0]), data[1] % 3, data + 2, size - 2)) {
        read_all();
    }
}

/* ---- Slurm ---- */

static struct slurm slurm = {.tag = "umbrage-01020304-"};

/* Words for scancel and scontrol are numbers of Slurm, never options. */
static void check_ids(struct umbj_words *ids)
{
    for (size_t i = 0; i < ids->count; i++) {
        FUZZ_DEMAND(strlen(ids->list[i]) < ID_SIZE);
        FUZZ_DEMAND(ids->list[i][0] >= '0' && ids->list[i][0] <= '9');
    }
    umbj_words_finish(ids);
}

static void feed(struct look *look, const char *text)
{
    char line[300];
    while (*text != '\0') {
        const size_t length = strcspn(text, "\n");
        (void)snprintf(line, sizeof line, "%.*s", (int)length, text);
        on_task(look, line);
        text += length + (text[length] == '\n');
    }
}

static void queue(const char *text)
{
    uint8_t known[TASKS + 1] = {0};
    char name[60];
    (void)snprintf(name, sizeof name, "%s.1.tiles", job_id);
    const struct umbj_farm_stage stage = {.name = name, .count = TASKS};
    struct look status = {.slurm = &slurm, .task = note_known, .stage = &stage, .known = known};
    struct look cancel = {.slurm = &slurm, .task = note_try, .name = job_id};
    struct look orphans = {.slurm = &slurm, .task = note_orphan, .work = fuzz_folder()};
    feed(&status, text);
    for (size_t i = 0; i < TASKS; i++) {
        FUZZ_DEMAND(known[i] <= UMBJ_TASK_RUNS);
    }
    FUZZ_DEMAND(known[TASKS] == 0);
    check_ids(&status.held);
    feed(&cancel, text);
    check_ids(&cancel.ending);
    feed(&orphans, text);
    check_ids(&orphans.ending);
}

/* The words for sbatch must name the wanted tasks and no others. */
static void arrays(const uint8_t *data, size_t size)
{
    char array[64];
    uint8_t wanted[200];
    const uint32_t count = (uint32_t)(size < sizeof wanted ? size : sizeof wanted);
    uint32_t named = 0, asked = 0;
    for (uint32_t i = 0; i < count; i++) {
        wanted[i] = data[i] & 1;
        asked += wanted[i];
    }
    for (uint32_t from = 0; from < count;) {
        const uint32_t next = write_array(wanted, from, count, array, sizeof array);
        FUZZ_DEMAND(next > from && strlen(array) < sizeof array);
        for (const char *at = array; *at != '\0';) {
            unsigned first = 0, last = 0;
            const int fields = sscanf(at, "%u-%u", &first, &last);
            FUZZ_DEMAND(fields >= 1);
            last = fields == 2 ? last : first;
            FUZZ_DEMAND(first <= last && from + last < next);
            for (unsigned i = first; i <= last; i++) {
                FUZZ_DEMAND(wanted[from + i]);
                named++;
            }
            at += strcspn(at, ",");
            at += *at == ',';
        }
        from = next;
    }
    FUZZ_DEMAND(named == asked);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0 || size > 32768) {
        return 0;
    }
    char *text = malloc(size);
    FUZZ_DEMAND(text != NULL);
    memcpy(text, data + 1, size - 1);
    text[size - 1] = '\0';
    if (data[0] % 3 == 0) {
        rows((const uint8_t *)text, size - 1);
    } else if (data[0] % 3 == 1) {
        queue(text);
    } else {
        arrays((const uint8_t *)text, size - 1);
    }
    free(text);
    return 0;
}
