/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Command lines and their processes, see worker_process.h. Between fork and exec only
 * async-signal-safe calls are made, because the daemon has many threads.
 */
#define _GNU_SOURCE /* close_range, pipe2 */
#include "jobs/worker_process.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sysexits.h>
#include <unistd.h>

#include "common/child_process.h"
#include "common/file_system.h"
#include "tool/clock.h"

#define NOT_STARTED 127
#define STEP_MS     20    /* between checks for its end */
#define NICENESS    5     /* queries come first */
#define GRACE_MS    3000  /* from SIGTERM to SIGKILL: it may have to end work elsewhere */
#define RESOLUTION  16384 /* umbrage-bake's resolution without the option */

/* Takes a word over; NULL: out of memory. */
static void take_word(struct umbj_words *words, char *word)
{
    char **list = word != NULL && !words->failed
                      ? realloc(words->list, (words->count + 2) * sizeof *list)
                      : NULL;
    if (list == NULL) {
        words->failed = 1;
        free(word);
        return;
    }
    words->list = list;
    list[words->count++] = word;
    list[words->count] = NULL;
}

void umbj_words_add(struct umbj_words *words, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    char *word = length >= 0 ? malloc((size_t)length + 1) : NULL;
    if (word != NULL) {
        va_start(arguments, format);
        (void)vsnprintf(word, (size_t)length + 1, format, arguments);
        va_end(arguments);
    }
    take_word(words, word);
}

void umbj_words_add_all(struct umbj_words *words, ...)
{
    va_list list;
    va_start(list, words);
    const char *word = va_arg(list, const char *);
    while (word != NULL) {
        take_word(words, strdup(word));
        word = va_arg(list, const char *);
    }
    va_end(list);
}

void umbj_words_add_sandbox(struct umbj_words *words, const char *mode)
{
    umbj_words_add(words, "--sandbox=%s", mode != NULL ? mode : "required");
}

/* The line after this one; the last line may lack its end. */
static const char *next_line(const char *line)
{
    const size_t length = strcspn(line, "\n");
    return line + length + (line[length] == '\n');
}

/* Returns the value of the last --resolution. umbrage-bake itself refuses a value that is not a
 * number. */
static unsigned long resolution_of(const char *settings)
{
    static const char name[] = "--resolution=";
    unsigned long resolution = RESOLUTION;
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        if (strncmp(line, name, sizeof name - 1) == 0) {
            resolution = strtoul(line + sizeof name - 1, NULL, 10);
        }
    }
    return resolution;
}

unsigned long umbj_tile_edge(const char *settings, uint32_t tile)
{
    const unsigned long resolution = resolution_of(settings);
    return resolution >= 64 && resolution < tile ? resolution : tile;
}

void umbj_words_add_settings(struct umbj_words *words, const char *settings, uint32_t tile)
{
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        umbj_words_add(words, "%.*s", (int)strcspn(line, "\n"), line);
    }
    if (tile > 0) { /* behind the settings: umbrage-bake refuses those by their own names */
        umbj_words_add(words, "--tile=%lu", umbj_tile_edge(settings, tile));
    }
}

void umbj_words_finish(struct umbj_words *words)
{
    for (size_t i = 0; i < words->count; i++) {
        free(words->list[i]);
    }
    free(words->list);
    *words = (struct umbj_words){0};
}

int umbj_settings_have(const char *settings, const char *wanted)
{
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        const size_t length = strcspn(line, "\n");
        if (length == strlen(wanted) && memcmp(line, wanted, length) == 0) {
            return 1;
        }
    }
    return 0;
}

/* Bytes of a pipe that are not a whole line yet. */
struct line_reader {
    int fd;
    size_t used;
    int skipping; /* 1 after a line that was too long, until its end */
    char text[UMBJ_CAUSE_SIZE];
};

static void take_bytes(struct line_reader *reader, const char *bytes, size_t count,
                       void (*line)(void *, const char *), void *user)
{
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] == '\n') {
            reader->text[reader->used] = '\0';
            if (reader->used > 0) {
                line(user, reader->text);
            }
            reader->used = 0;
            reader->skipping = 0;
        } else if (reader->used + 1 < sizeof reader->text && !reader->skipping) {
            reader->text[reader->used++] = bytes[i];
        } else {
            reader->skipping = 1;
        }
    }
}

/* Reads the available bytes; closes the pipe at its end. */
static void read_lines(struct line_reader *reader, void (*line)(void *, const char *), void *user)
{
    char chunk[4096];
    /* A process that writes without end must not block the loop. */
    for (int rounds = 0; rounds < 64; rounds++) {
        ssize_t count = read(reader->fd, chunk, sizeof chunk);
        if (count > 0) {
            take_bytes(reader, chunk, (size_t)count, line, user);
        } else if (count == 0 || (errno != EAGAIN && errno != EINTR)) {
            take_bytes(reader, "\n", 1, line, user);
            umbs_hang_up(&reader->fd);
            return;
        } else if (errno == EAGAIN) {
            return;
        }
    }
}

/* Makes this process the first one that the kernel kills when memory is short. A failure is
 * ignored. */
static void offer_to_oom_killer(void)
{
    int fd = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
    if (fd >= 0) {
        (void)!write(fd, "500", 3);
        close(fd);
    }
}

/* In the child: never returns. */
static void become_program(const struct umbj_process *process, char *const *words,
                           char *const *environment, int said, int progress, pid_t parent)
{
    const uint64_t bytes = process->max_output_bytes;
    int sources[UMBJ_WORKER_FD_PROGRESS + 1] = {-1, -1, said, progress};
    if (umbs_child_own_group(parent) != 0 ||
        umbs_child_lay_out(sources, UMBJ_WORKER_FD_PROGRESS + 1) != 0 ||
        umbs_child_limit(RLIMIT_CORE, 0, 0) != 0 ||
        umbs_child_limit(RLIMIT_FSIZE, bytes, bytes) != 0 || umbs_child_reset_signals() != 0 ||
        chdir(process->folder) != 0) {
        _exit(NOT_STARTED);
    }
    (void)setpriority(PRIO_PROCESS, 0, NICENESS);
    offer_to_oom_killer();
    execve(words[0], words, environment);
    _exit(NOT_STARTED);
}

/* Passes lines on until the child has ended, or must be ended. */
static void attend(const struct umbj_process *process, pid_t child, struct line_reader *said,
                   struct line_reader *progress, struct umbj_process_end *end)
{
    int64_t deadline = umbu_clock_ms() + (int64_t)process->timeout_ms;
    while (!umbs_child_has_ended(child)) {
        struct pollfd wanted[3] = {{.fd = end->stopped ? -1 : process->stop, .events = POLLIN},
                                   {.fd = said->fd, .events = POLLIN},
                                   {.fd = progress->fd, .events = POLLIN}};
        (void)poll(wanted, 3, STEP_MS);
        if (wanted[1].revents != 0) {
            read_lines(said, process->said, process->user);
        }
        if (wanted[2].revents != 0) {
            read_lines(progress, process->progress, process->user);
        }
        if (wanted[0].revents != 0) {
            end->stopped = 1;
            deadline = umbu_clock_ms() + GRACE_MS;
            (void)kill(child, SIGTERM);
        } else if (umbu_clock_ms() > deadline) {
            end->timed_out = !end->stopped;
            (void)kill(child, SIGKILL); /* it may have no group yet */
            return;
        }
    }
}

static enum umb_status supervise(const struct umbj_process *process, pid_t child,
                                 struct line_reader *said, struct line_reader *progress,
                                 struct umbj_process_end *end, struct umb_error *error)
{
    attend(process, child, said, progress, end);
    const int known = umbs_child_reap(child, &end->exit_code, &end->signal);
    if (said->fd >= 0) {
        read_lines(said, process->said, process->user);
    }
    if (progress->fd >= 0) {
        read_lines(progress, process->progress, process->user);
    }
    return known ? UMB_OK : umb_fail(error, UMB_E_INTERNAL, "worker: its exit status is lost");
}

/* Starts the process. Out: child, and both pipes; the caller closes all their ends, on failure
 * too. */
static enum umb_status start(const struct umbj_process *process, const struct umbj_words *words,
                             int said[2], int progress[2], pid_t *child, struct umb_error *error)
{
    char *environment[UMBS_CHILD_ENVIRONMENT_MAX];
    if (words->failed) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a command line");
    }
    if (pipe2(said, O_CLOEXEC) != 0 || pipe2(progress, O_CLOEXEC) != 0) {
        return umb_fail_errno(error, UMB_E_LIMIT, errno, "worker: no pipe");
    }
    (void)fcntl(said[0], F_SETFL, O_NONBLOCK);
    (void)fcntl(progress[0], F_SETFL, O_NONBLOCK);
    umbs_child_environment(environment);
    const pid_t parent = getpid();
    *child = fork();
    if (*child == 0) {
        become_program(process, words->list, environment, said[1], progress[1], parent);
    }
    return *child > 0 ? UMB_OK : umb_fail_errno(error, UMB_E_LIMIT, errno, "worker: no process");
}

enum umb_status umbj_process_run(const struct umbj_process *process, struct umbj_words *words,
                                 struct umbj_process_end *end, struct umb_error *error)
{
    int said[2] = {-1, -1}, progress[2] = {-1, -1};
    pid_t child = -1;
    *end = (struct umbj_process_end){.exit_code = -1};
    enum umb_status status = start(process, words, said, progress, &child, error);
    umbj_words_finish(words);
    umbs_hang_up(&said[1]);
    umbs_hang_up(&progress[1]);
    struct line_reader talk = {.fd = said[0]}, steps = {.fd = progress[0]};
    if (status == UMB_OK) {
        status = supervise(process, child, &talk, &steps, end, error);
    }
    umbs_hang_up(&talk.fd);
    umbs_hang_up(&steps.fd);
    return status;
}

enum umbj_failure umbj_process_judge(const struct umbj_process_end *end)
{
    if (end->timed_out) {
        return UMBJ_TIMEOUT;
    }
    if (end->stopped) {
        return UMBJ_CANCELLED;
    }
    if (end->signal != 0) {
        return end->signal == SIGSYS    ? UMBJ_SANDBOX
               : end->signal == SIGKILL ? UMBJ_MEMORY
                                        : UMBJ_CRASH;
    }
    switch (end->exit_code) {
    case 0:
        return UMBJ_NO_FAILURE;
    case 2: /* a setting that the program refuses */
    case EX_DATAERR:
    case EX_NOINPUT:
        return UMBJ_REJECTED;
    case EX_TEMPFAIL:
        return UMBJ_TEMPORARY;
    case EX_CANTCREAT:
    case EX_IOERR:
        return UMBJ_IO;
    default:
        return UMBJ_INTERNAL;
    }
}
