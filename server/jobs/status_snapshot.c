/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The snapshot, see status_snapshot.h: a hash table of jobs and one of (asset, owner) pairs. Both
 * use the first byte of the id.
 */
#include "jobs/status_snapshot.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>

#define BUCKETS 1024 /* a power of 2 */

struct entry {
    LIST_ENTRY(entry) link;
    STAILQ_ENTRY(entry) over; /* link of finished jobs, in the order of their ends */
    struct umbj_standing standing;
    int64_t phase_at_ms; /* when the phase began; 0 = not known */
    int is_over;
};

struct owned {
    LIST_ENTRY(owned) link;
    uint8_t asset[UMBJ_HASH_BYTES];
    char owner[UMBJ_OWNER_SIZE];
};

struct umbj_snapshot {
    pthread_mutex_t mutex;
    LIST_HEAD(, entry) jobs[BUCKETS];
    LIST_HEAD(, owned) assets[BUCKETS];
    STAILQ_HEAD(, entry) over;
    size_t over_count;
    uint64_t version;
};

enum umb_status umbj_snapshot_create(struct umbj_snapshot **out, struct umb_error *error)
{
    *out = calloc(1, sizeof **out);
    if (*out == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the jobs' snapshot");
    }
    STAILQ_INIT(&(*out)->over);
    pthread_mutex_init(&(*out)->mutex, NULL);
    return UMB_OK;
}

static void entry_free(struct entry *entry)
{
    LIST_REMOVE(entry, link);
    free(entry->standing.plan);
    free(entry->standing.notices);
    free(entry);
}

static void owned_free(struct owned *owned)
{
    LIST_REMOVE(owned, link);
    free(owned);
}

void umbj_snapshot_destroy(struct umbj_snapshot *snapshot)
{
    if (snapshot == NULL) {
        return;
    }
    for (size_t i = 0; i < BUCKETS; i++) {
        while (!LIST_EMPTY(&snapshot->jobs[i])) {
            entry_free(LIST_FIRST(&snapshot->jobs[i]));
        }
        while (!LIST_EMPTY(&snapshot->assets[i])) {
            owned_free(LIST_FIRST(&snapshot->assets[i]));
        }
    }
    pthread_mutex_destroy(&snapshot->mutex);
    free(snapshot);
}

/* Ids are random hexadecimal digits. */
static size_t bucket_of_job(const char *id)
{
    size_t bucket = 0;
    for (int i = 0; i < 8 && id[i] != '\0'; i++) {
        bucket = bucket * 31 + (unsigned char)id[i];
    }
    return bucket % BUCKETS;
}

static size_t bucket_of_asset(const uint8_t *asset)
{
    return ((size_t)asset[0] << 8 | asset[1]) % BUCKETS;
}

static struct entry *find(struct umbj_snapshot *snapshot, const char *id)
{
    struct entry *entry = LIST_FIRST(&snapshot->jobs[bucket_of_job(id)]);
    while (entry != NULL && strcmp(entry->standing.job.id, id) != 0) {
        entry = LIST_NEXT(entry, link);
    }
    return entry;
}

static struct entry *find_or_add(struct umbj_snapshot *snapshot, const char *id)
{
    struct entry *entry = find(snapshot, id);
    if (entry == NULL && (entry = calloc(1, sizeof *entry)) != NULL) {
        LIST_INSERT_HEAD(&snapshot->jobs[bucket_of_job(id)], entry, link);
        entry->standing.left_ms = -1;
    }
    return entry;
}

/* Notes a finished job, and drops the one that ended first if there are too many. */
static void note_end(struct umbj_snapshot *snapshot, struct entry *entry)
{
    if (entry->is_over) {
        return;
    }
    entry->is_over = 1;
    STAILQ_INSERT_TAIL(&snapshot->over, entry, over);
    if (++snapshot->over_count > UMBJ_SNAPSHOT_MAX) {
        struct entry *oldest = STAILQ_FIRST(&snapshot->over);
        STAILQ_REMOVE_HEAD(&snapshot->over, over);
        snapshot->over_count--;
        entry_free(oldest);
    }
}

static void clear_progress(struct umbj_standing *standing)
{
    standing->done = standing->total = 0;
    standing->rate = 0;
    standing->left_ms = -1;
    standing->unit[0] = '\0';
}

void umbj_snapshot_set(struct umbj_snapshot *snapshot, const struct umbj_job *job, int loading)
{
    pthread_mutex_lock(&snapshot->mutex);
    struct entry *entry = find_or_add(snapshot, job->id);
    if (entry != NULL) {
        struct umbj_standing *standing = &entry->standing;
        if (standing->job.epoch != job->epoch || job->state != UMBJ_RUNNING || loading) {
            clear_progress(standing);
            standing->phase[0] = '\0';
        }
        standing->job = *job;
        standing->loading = loading;
        if (loading) {
            memcpy(standing->phase, "load", sizeof "load");
        }
        standing->version = ++snapshot->version;
        if (umbj_is_over(job->state) && !loading) {
            note_end(snapshot, entry);
        }
    }
    pthread_mutex_unlock(&snapshot->mutex);
}

/* Appends a line to a text of lines. The line is dropped if the text would exceed its limit or
 * memory is short. */
static void add_line(char **text, const char *line)
{
    const size_t have = *text != NULL ? strlen(*text) : 0, more = strlen(line);
    if (have + more + 2 > UMBJ_PLAN_MAX) {
        return;
    }
    char *longer = realloc(*text, have + more + 2);
    if (longer != NULL) {
        memcpy(longer + have, line, more);
        memcpy(longer + have + more, "\n", 2);
        *text = longer;
    }
}

static void copy_word(char out[UMBJ_PHASE_SIZE], const char *text)
{
    (void)snprintf(out, UMBJ_PHASE_SIZE, "%.*s", UMBJ_PHASE_SIZE - 1, text);
}

static void take_progress(struct entry *entry, const struct umbj_report *report, int64_t now_ms)
{
    struct umbj_standing *standing = &entry->standing;
    const double seconds = 1e-3 * (double)(now_ms - entry->phase_at_ms);
    standing->done = report->done < report->total ? report->done : report->total;
    standing->total = report->total;
    copy_word(standing->unit, report->text);
    standing->rate = seconds > 0 ? (double)standing->done / seconds : 0;
    standing->left_ms =
        standing->rate > 0
            ? (int64_t)(1e3 * (double)(standing->total - standing->done) / standing->rate)
            : -1;
}

/* Takes a worker's report on its tiles; its numbers are not trusted. */
static struct umbj_tiles take_tiles(struct entry *entry, const struct umbj_report *report)
{
    const struct umbj_tiles before = entry->standing.tiles;
    struct umbj_tiles *now = &entry->standing.tiles;
    now->total = report->total;
    now->done = report->done < report->total ? report->done : report->total;
    now->found = report->found < now->done ? report->found : now->done;
    return (struct umbj_tiles){.done = now->done > before.done ? now->done - before.done : 0,
                               .found = now->found > before.found ? now->found - before.found : 0};
}

static void take_report(struct entry *entry, const struct umbj_report *report, int64_t now_ms)
{
    if (report->kind == UMBJ_REPORT_PHASE) {
        copy_word(entry->standing.phase, report->text);
        clear_progress(&entry->standing);
        entry->phase_at_ms = now_ms;
    } else if (report->kind == UMBJ_REPORT_PROGRESS) {
        take_progress(entry, report, now_ms);
    } else if (report->kind == UMBJ_REPORT_PLAN) {
        add_line(&entry->standing.plan, report->text);
    } else if (report->kind == UMBJ_REPORT_NOTICE) {
        add_line(&entry->standing.notices, report->text);
    }
}

/* Clears plan, notices and tiles, which each try reports anew. */
static void forget_try(struct entry *entry)
{
    entry->standing.tiles = (struct umbj_tiles){0, 0, 0};
    free(entry->standing.plan);
    free(entry->standing.notices);
    entry->standing.plan = entry->standing.notices = NULL;
}

struct umbj_tiles umbj_snapshot_report(struct umbj_snapshot *snapshot,
                                       const struct umbj_report *report, int64_t now_ms)
{
    struct umbj_tiles more = {0, 0, 0};
    pthread_mutex_lock(&snapshot->mutex);
    struct entry *entry = find(snapshot, report->job);
    if (entry != NULL && entry->standing.job.epoch == report->epoch) {
        if (report->kind == UMBJ_REPORT_PHASE && entry->standing.phase[0] == '\0') {
            forget_try(entry);
        }
        if (report->kind == UMBJ_REPORT_TILES) {
            more = take_tiles(entry, report);
        } else {
            take_report(entry, report, now_ms);
        }
        entry->standing.version = ++snapshot->version;
    }
    pthread_mutex_unlock(&snapshot->mutex);
    return more;
}

struct umbj_tiles umbj_snapshot_tiles(struct umbj_snapshot *snapshot)
{
    struct umbj_tiles sum = {0, 0, 0};
    pthread_mutex_lock(&snapshot->mutex);
    for (size_t i = 0; i < BUCKETS; i++) {
        const struct entry *at;
        LIST_FOREACH(at, &snapshot->jobs[i], link)
        {
            const int running = at->standing.job.state == UMBJ_RUNNING;
            sum.done += running ? at->standing.tiles.done : 0;
            sum.total += running ? at->standing.tiles.total : 0;
            sum.found += running ? at->standing.tiles.found : 0;
        }
    }
    pthread_mutex_unlock(&snapshot->mutex);
    return sum;
}

int umbj_snapshot_look(struct umbj_snapshot *snapshot, const char *id, const char *owner,
                       void (*look)(void *user, const struct umbj_standing *standing), void *user)
{
    pthread_mutex_lock(&snapshot->mutex);
    const struct entry *entry = find(snapshot, id);
    const int found =
        entry != NULL && (owner == NULL || strcmp(owner, entry->standing.job.owner) == 0);
    if (found) {
        look(user, &entry->standing);
    }
    pthread_mutex_unlock(&snapshot->mutex);
    return found;
}

uint64_t umbj_snapshot_version(struct umbj_snapshot *snapshot, const char *id)
{
    pthread_mutex_lock(&snapshot->mutex);
    const struct entry *entry = find(snapshot, id);
    const uint64_t version = entry != NULL ? entry->standing.version : 0;
    pthread_mutex_unlock(&snapshot->mutex);
    return version;
}

static struct owned *find_owned(struct umbj_snapshot *snapshot, const uint8_t *asset,
                                const char *owner)
{
    struct owned *at = LIST_FIRST(&snapshot->assets[bucket_of_asset(asset)]);
    while (at != NULL &&
           (memcmp(at->asset, asset, UMBJ_HASH_BYTES) != 0 || strcmp(at->owner, owner) != 0)) {
        at = LIST_NEXT(at, link);
    }
    return at;
}

void umbj_snapshot_own(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner)
{
    struct owned *owned = NULL;
    pthread_mutex_lock(&snapshot->mutex);
    if (find_owned(snapshot, asset, owner) == NULL && (owned = calloc(1, sizeof *owned)) != NULL) {
        memcpy(owned->asset, asset, UMBJ_HASH_BYTES);
        memcpy(owned->owner, owner, strlen(owner) + 1); /* checked where owners are read */
        LIST_INSERT_HEAD(&snapshot->assets[bucket_of_asset(asset)], owned, link);
    }
    pthread_mutex_unlock(&snapshot->mutex);
}

void umbj_snapshot_disown(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner)
{
    struct owned *next;
    pthread_mutex_lock(&snapshot->mutex);
    for (struct owned *at = LIST_FIRST(&snapshot->assets[bucket_of_asset(asset)]); at != NULL;
         at = next) {
        next = LIST_NEXT(at, link);
        if (memcmp(at->asset, asset, UMBJ_HASH_BYTES) == 0 &&
            (owner == NULL || strcmp(at->owner, owner) == 0)) {
            owned_free(at);
        }
    }
    pthread_mutex_unlock(&snapshot->mutex);
}

int umbj_snapshot_owns(struct umbj_snapshot *snapshot, const uint8_t *asset, const char *owner)
{
    pthread_mutex_lock(&snapshot->mutex);
    const int owns = find_owned(snapshot, asset, owner) != NULL;
    pthread_mutex_unlock(&snapshot->mutex);
    return owns;
}
