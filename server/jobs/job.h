/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_H
#define UMBRAGE_SERVER_JOBS_JOB_H
/*
 * A bake job: one submission of a scene with its settings, by one owner.
 *
 *     queued -> running -> done
 *        ^         |-----> failed    another try is useless, or the job was cancelled
 *        '---------'-----> poison    its tries crashed or lost their workers too often
 *
 * Each try has an epoch, a number that grows with every claim. A report for an older epoch is
 * refused and changes nothing (fencing).
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBJ_HASH_BYTES    32 /* SHA-256: keys, ids of assets */
#define UMBJ_ID_SIZE       33 /* 32 hexadecimal digits, random: an id reveals nothing */
#define UMBJ_OWNER_SIZE    64 /* a token's name; "" = the owner without tokens */
#define UMBJ_CAUSE_SIZE    512
#define UMBJ_SCENE_SIZE    1024 /* path of the scene in its bundle */
#define UMBJ_SETTINGS_SIZE 8192 /* lines of --name=value */
#define UMBJ_PRIORITY_MAX  10 /* highest priority; the lowest is -10; it orders one owner's jobs */

enum umbj_state {
    UMBJ_QUEUED = 0,
    UMBJ_RUNNING,
    UMBJ_DONE,
    UMBJ_FAILED,
    UMBJ_POISON,
    UMBJ_STATE_COUNT,
};

/* Reason why a try ended without an asset. */
enum umbj_failure {
    UMBJ_NO_FAILURE = 0,
    UMBJ_REJECTED,  /* the scene or its settings are unusable (exit codes 65, 2, 66) */
    UMBJ_TEMPORARY, /* may succeed later (75) */
    UMBJ_IO,        /* disk (73, 74): a full one may get free space */
    UMBJ_LOST,      /* the lease expired, or the daemon ended */
    UMBJ_CRASH,     /* a signal ended the worker */
    UMBJ_MEMORY,    /* SIGKILL, not sent by the daemon */
    UMBJ_SANDBOX,   /* SIGSYS: a forbidden system call */
    UMBJ_TIMEOUT,   /* over its time limit */
    UMBJ_INTERNAL,  /* fault of the program (70, 69, unknown) */
    UMBJ_CANCELLED, /* by its owner */
    UMBJ_FAILURE_COUNT,
};

struct umbj_job {
    char id[UMBJ_ID_SIZE];
    char owner[UMBJ_OWNER_SIZE];
    uint8_t key[UMBJ_HASH_BYTES]; /* hash of bundle and settings */
    enum umbj_state state;
    enum umbj_failure failure; /* failure of the last try */
    int priority;              /* -10..10, higher first */
    int64_t epoch;             /* epoch of the last claim; 0 = never claimed */
    int64_t tries, hard_tries; /* number of failed tries; of those that took the worker down */
    int64_t submitted_ms, started_ms, ended_ms; /* Unix time; 0 = not yet */
    int64_t not_before_ms;
    int64_t lease_until_ms; /* Time on the steady clock of the process that claimed it */
    int64_t bundle_bytes;
    int has_asset;
    uint8_t asset[UMBJ_HASH_BYTES]; /* id, when done */
    char cause[UMBJ_CAUSE_SIZE];    /* cause of the last failure, one sentence */
    int64_t row;                    /* Number of its row in the table */
    const char *damage;             /* Name of the damaged column of its row; NULL = none */
};

/* "queued"; "rejected". Never NULL. */
const char *umbj_state_name(enum umbj_state state);
const char *umbj_failure_name(enum umbj_failure failure);

/* 1 if the job will not change any more. */
int umbj_is_over(enum umbj_state state);

#endif
