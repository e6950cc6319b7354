/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_COMMAND_H
#define UMBRAGE_SERVER_STUDY_STUDY_COMMAND_H
/*
 * The sub-commands of umbrage-study. argv[0] is the sub-command's name. Each writes data to stdout
 * and messages to stderr, and returns the process's exit code.
 */

int umbt_render_command(int argc, char **argv);
int umbt_verify_command(int argc, char **argv);
int umbt_points_command(int argc, char **argv);
int umbt_study_command(int argc, char **argv);
int umbt_techniques_command(int argc, char **argv);
int umbt_aliasing_command(int argc, char **argv);
int umbt_deep_command(int argc, char **argv);

#endif
