/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_TABLE_H
#define UMBRAGE_SERVER_JOBS_JOB_TABLE_H
/*
 * The durable table of bake jobs, and of the owners of the assets that jobs made.
 *
 *     umbj_table_open("jobs.db", &limits, &table, &error);
 *     umbj_table_recover(table, now, &count, &error);       once: running jobs lost their worker
 *     umbj_table_submit(table, &submission, now, &job, &is_new, &error);
 *     umbj_table_claim(table, now, steady, &job, &error);   the next in fair order
 *     umbj_table_renew / _finish / _fail (table, id, epoch, ...);
 *
 * Acknowledged changes survive kill -9 and power cuts (job_sql.h).
 *
 * Clocks: time is an argument, so that tests control it. `now` is in Unix milliseconds, `steady` in
 * milliseconds of a monotonic clock. Leases use `steady` and end with the process: after a start,
 * running jobs have lost their worker. Pauses use `now`. A pause that seems longer than the longest
 * one means that the clock was set back; such a pause counts as over.
 *
 * Order: owners take turns. The owner with the fewest running jobs comes first, then the one whose
 * last start is longest ago. Among one owner's jobs the higher priority comes first, then the older
 * job. More submissions give an owner no larger share.
 *
 * Tries: rejected, timeout, internal and cancelled end a job at once. Temporary, io and lost are
 * tried again after a pause that doubles, UMBJ_TRIES_MAX times; then a job with temporary or io is
 * failed, one with lost is poison. Crash, memory and sandbox are tried once more; then the job is
 * poison.
 *
 * Rows are checked when they are read: a damaged row is a failed job.
 *
 * Threads: one at a time.
 */
#include "jobs/job.h"

#define UMBJ_TRIES_MAX      6    /* number of failed tries after which a job ends */
#define UMBJ_HARD_TRIES_MAX 2    /* number of tries that may take the worker down */
#define UMBJ_PAUSE_MS       1000 /* milliseconds after the first failed try; each pause doubles */
#define UMBJ_PAUSE_MAX_MS   300000

struct umbj_table; /* opaque */

struct umbj_limits {
    int64_t owner_jobs;    /* Limit of the unfinished jobs of one owner */
    int64_t owner_bytes;   /* Limit of the bytes of one owner's bundles */
    int64_t total_bytes;   /* Limit of the bytes of all bundles */
    int64_t lease_ms;      /* Milliseconds without a report after which a try is lost */
    int64_t owner_assets;  /* Limit of the bytes of one owner's assets; 0 = none */
    int64_t owner_history; /* Limit of the finished jobs of one owner; 0 = none */
};

/* The quota that refused. */
enum umbj_quota {
    UMBJ_QUOTA_JOBS = 0, /* owner_jobs */
    UMBJ_QUOTA_BYTES,    /* owner_bytes */
    UMBJ_QUOTA_SPACE,    /* total_bytes */
    UMBJ_QUOTA_ASSETS,   /* owner_assets */
    UMBJ_QUOTA_COUNT,
};

/* Name of a quota, such as "jobs". Never NULL. */
const char *umbj_quota_name(enum umbj_quota quota);

struct umbj_submission {
    const char *owner;
    const uint8_t *key; /* [UMBJ_HASH_BYTES] */
    int priority;
    const char *scene, *settings; /* UMBJ_SCENE_SIZE, UMBJ_SETTINGS_SIZE at most */
    int64_t bundle_bytes;
};

/* Opens or creates a table. Fails: as umbj_sql_open; E_VERSION (a newer program made the table). */
UMB_CHECKED enum umb_status umbj_table_open(const char *path, const struct umbj_limits *limits,
                                            struct umbj_table **out, struct umb_error *error);
void umbj_table_close(struct umbj_table *table); /* NULL is allowed */

/* Makes every later write fail with E_IO, because another daemon now owns the table. */
UMB_CHECKED enum umb_status umbj_table_freeze(struct umbj_table *table, struct umb_error *error);

/*
 * Adds a job. If the same owner has a job of the same key that is queued or running, or done with
 * an asset that the owner still has, that job is returned instead.
 *
 * Fails: E_BUSY (a quota of the owner; the message names it), E_LIMIT (disk; all bundles).
 */
UMB_CHECKED enum umb_status umbj_table_submit(struct umbj_table *table,
                                              const struct umbj_submission *submission, int64_t now,
                                              struct umbj_job *job, int *is_new,
                                              struct umb_error *error);

/* Finds the existing job that umbj_table_submit would return. Fails: E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_find_same(struct umbj_table *table, const char *owner,
                                                 const uint8_t *key, struct umbj_job *job,
                                                 struct umb_error *error);

/* Uploads in progress, which count for the quotas as jobs do. */
struct umbj_pending {
    int64_t own_jobs, own_bytes; /* Number of the owner's uploads, and bytes of their bundles */
    int64_t all_bytes;           /* Bytes of all owners' bundles */
};

/* Checks whether the owner's quotas allow one more job of that size. pending: uploads that count
 * too; NULL = none. Fails: as umbj_table_submit. */
UMB_CHECKED enum umb_status umbj_table_check_quota(struct umbj_table *table, const char *owner,
                                                   int64_t bundle_bytes,
                                                   const struct umbj_pending *pending,
                                                   struct umb_error *error);

/* Number of refusals by a quota since the table was opened. */
int64_t umbj_table_refused(const struct umbj_table *table, enum umbj_quota quota);

/* Jobs and bytes kept for an owner (NULL: for all owners together). */
struct umbj_kept {
    int64_t jobs;        /* Number of finished jobs */
    int64_t asset_bytes; /* an asset of two owners counts for both */
};
UMB_CHECKED enum umb_status umbj_table_kept(struct umbj_table *table, const char *owner,
                                            struct umbj_kept *kept, struct umb_error *error);

/* Checks whether the owner's quota allows an asset of `bytes` bytes. Fails: E_BUSY
 * (owner_assets). */
UMB_CHECKED enum umb_status umbj_table_check_asset(struct umbj_table *table, const char *owner,
                                                   const uint8_t *asset, int64_t bytes,
                                                   struct umb_error *error);

/* Forgets an owner's oldest finished jobs beyond owner_history. */
UMB_CHECKED enum umb_status umbj_table_trim(struct umbj_table *table, const char *owner,
                                            struct umb_error *error);

/* Starts the next job in fair order: its state becomes running, with a new epoch and a lease.
 * Fails: E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_claim(struct umbj_table *table, int64_t now, int64_t steady,
                                             struct umbj_job *job, struct umb_error *error);

/* Reads the scene and settings for a worker. Fails: E_NOT_FOUND, E_CORRUPT (a damaged row). */
UMB_CHECKED enum umb_status umbj_table_spec(struct umbj_table *table, const char *id,
                                            char scene[UMBJ_SCENE_SIZE],
                                            char settings[UMBJ_SETTINGS_SIZE],
                                            struct umb_error *error);

/* Renews the lease of an epoch. Fails: E_STATE if that epoch is not the running one; nothing is
 * changed. */
UMB_CHECKED enum umb_status umbj_table_renew(struct umbj_table *table, const char *id,
                                             int64_t epoch, int64_t steady,
                                             struct umb_error *error);

/* Records that the asset is in the store: the job is done, its owner owns the asset, and the key is
 * remembered for later bakes. bake_ms: duration of the bake in milliseconds. */
UMB_CHECKED enum umb_status umbj_table_finish(struct umbj_table *table, const struct umbj_job *job,
                                              const uint8_t *asset, int64_t bake_ms, int64_t now,
                                              struct umb_error *error);

/* Records a failed try. Out: *job: the job's new state: queued again, failed or poison. */
UMB_CHECKED enum umb_status umbj_table_fail(struct umbj_table *table, struct umbj_job *job,
                                            enum umbj_failure failure, const char *cause,
                                            int64_t now, struct umb_error *error);

/* Cancels a job of an owner (NULL = any owner) if the job has not ended. Fails: E_NOT_FOUND, also
 * for other owners' jobs. */
UMB_CHECKED enum umb_status umbj_table_cancel(struct umbj_table *table, const char *id,
                                              const char *owner, int64_t now, struct umbj_job *job,
                                              struct umb_error *error);

/* The next running job whose lease has expired. Fails: E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_expired(struct umbj_table *table, int64_t steady,
                                               struct umbj_job *job, struct umb_error *error);

/* Recovers the table after a start: retires damaged rows, queues running jobs again as lost, and
 * counts all rows. Out: count: number of lost jobs. */
UMB_CHECKED enum umb_status umbj_table_recover(struct umbj_table *table, int64_t now,
                                               int64_t *count, struct umb_error *error);

/* Number of damaged rows since the table was opened. */
int64_t umbj_table_damaged(const struct umbj_table *table);

/* Queues running jobs again before a planned end, without counting a try. */
UMB_CHECKED enum umb_status umbj_table_release(struct umbj_table *table, struct umb_error *error);

/* Reads a job of an owner (NULL = any owner). Fails: E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_get(struct umbj_table *table, const char *id,
                                           const char *owner, struct umbj_job *job,
                                           struct umb_error *error);

/* Reads an owner's jobs (NULL = all), newest first, at most `most`. free() the array. */
UMB_CHECKED enum umb_status umbj_table_list(struct umbj_table *table, const char *owner,
                                            int64_t most, struct umbj_job **jobs, size_t *count,
                                            struct umb_error *error);

/* Counts jobs by state. */
UMB_CHECKED enum umb_status umbj_table_count(struct umbj_table *table,
                                             int64_t counts[UMBJ_STATE_COUNT],
                                             struct umb_error *error);

/* Returns the time when the next queued job may start: now or later; INT64_MAX if no job is
 * queued. */
UMB_CHECKED enum umb_status umbj_table_next_start(struct umbj_table *table, int64_t now,
                                                  int64_t *when, struct umb_error *error);

/* Number of unfinished jobs that need the bundle of a key. */
UMB_CHECKED enum umb_status umbj_table_bundle_users(struct umbj_table *table, const uint8_t *key,
                                                    int64_t *count, struct umb_error *error);

/* Removes jobs that ended before a time. */
UMB_CHECKED enum umb_status umbj_table_prune(struct umbj_table *table, int64_t before,
                                             struct umb_error *error);

/* --- assets that jobs made (job_assets.c) --- */

/* Adds an asset and its size. Call it before the asset's file gets its name, so that a crash leaves
 * no unknown file. */
UMB_CHECKED enum umb_status umbj_table_announce(struct umbj_table *table, const uint8_t *asset,
                                                int64_t bytes, struct umb_error *error);

/* Finds the next asset of unknown size, recorded by an older program. In: asset: the one found
 * before, or zeros. Fails: E_NOT_FOUND: there are no more. */
UMB_CHECKED enum umb_status umbj_table_next_unsized(struct umbj_table *table,
                                                    uint8_t asset[UMBJ_HASH_BYTES],
                                                    struct umb_error *error);

/* Finds the asset and the duration of an earlier bake of the key, by any owner. Fails:
 * E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_find_bake(struct umbj_table *table, const uint8_t *key,
                                                 uint8_t asset[UMBJ_HASH_BYTES], int64_t *bake_ms,
                                                 struct umb_error *error);

/* Finds whether an owner (NULL: any owner) has an asset. Out: owned: 1 or 0; 0 also on failure. */
UMB_CHECKED enum umb_status umbj_table_asset(struct umbj_table *table, const uint8_t *asset,
                                             const char *owner, int *owned,
                                             struct umb_error *error);

/* Takes the asset away from an owner (NULL = from all). Fails: E_NOT_FOUND if the owner does not
 * have it. */
UMB_CHECKED enum umb_status umbj_table_disown(struct umbj_table *table, const uint8_t *asset,
                                              const char *owner, struct umb_error *error);

/* umbj_table_unowned finds an asset without owners. umbj_table_forget removes the rows of such an
 * asset, after its file was removed, and the rows of its bakes. It removes nothing if the asset has
 * an owner again. Fails: E_NOT_FOUND. */
UMB_CHECKED enum umb_status umbj_table_unowned(struct umbj_table *table,
                                               uint8_t asset[UMBJ_HASH_BYTES],
                                               struct umb_error *error);
UMB_CHECKED enum umb_status umbj_table_forget(struct umbj_table *table, const uint8_t *asset,
                                              struct umb_error *error);

/* Calls found(user, asset, owner) for every asset and owner. */
typedef void (*umbj_owned_fn)(void *user, const uint8_t *asset, const char *owner);
UMB_CHECKED enum umb_status umbj_table_owned(struct umbj_table *table, umbj_owned_fn found,
                                             void *user, struct umb_error *error);

#endif
