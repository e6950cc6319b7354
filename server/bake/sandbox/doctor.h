/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
/* `umbrage-bake doctor`: what this machine offers the bake, and whether its sandbox holds. */

enum umbb_verdict {
    UMBB_ACT_ALLOWED = 0,
    UMBB_ACT_REFUSED = 1, /* the call failed for want of a right */
    UMBB_ACT_KILLED = 2,  /* the process was ended by the filter */
};

/*
 * Tries act number `index` (doctor_acts.h) in a process of its own, in the sandbox or, to test the
 * test, outside. Out: the verdict, or -1 if no process could be started or entered the sandbox.
 */
int umbb_doctor_try(unsigned index, int sandboxed);

/*
 * The command; argv as the process got it, argv[1] is "doctor".
 *
 * Out:  the exit code: 0 if every act is denied, 1 if one is not, 69 if a required layer is
 *       missing, 2 for wrong arguments, 0 in an exempt (sanitizer) build, which says so.
 */
int umbb_doctor(int argc, char **argv);

#endif
