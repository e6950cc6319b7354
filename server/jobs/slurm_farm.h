/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_SLURM_FARM_H
#define UMBRAGE_SERVER_JOBS_SLURM_FARM_H
/*
 * Slurm as a farm, through its command line: sbatch, squeue, scancel, scontrol (22.05). The library
 * is not used: its ABI changes with each release.
 *
 * Measured with Slurm 22.05: jobs accepted less than 5 s before its controller is killed are lost.
 * A task whose agent died runs on while a second one is started. Requeued tasks are held back for
 * 121 s.
 */
#include "jobs/farm.h"

struct umbj_slurm_options {
    const char *words;  /* more options of sbatch, with blanks between; NULL = none */
    const char *tag_of; /* jobs folder; its hash tells our tasks from those of other daemons */
    const char *search; /* PATH of Slurm's programs; NULL = the usual */
    const char *configuration; /* SLURM_CONF; NULL = Slurm's own */
};

/* Copies its options. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_slurm_farm_create(const struct umbj_slurm_options *options,
                                                   struct umbj_farm **out, struct umb_error *error);

#endif
