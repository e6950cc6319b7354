/* SPDX-License-Identifier: Apache-2.0 */
/* See child_process.h. */
#define _GNU_SOURCE /* close_range, environ */
#include "common/child_process.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define FD_SPARE 10 /* Lowest number for sources moved out of the way of the lower numbers */

void umbs_child_environment(char *chosen[UMBS_CHILD_ENVIRONMENT_MAX])
{
    static const char *const allowed[] = {
        "LD_LIBRARY_PATH=", "ASAN_OPTIONS=", "UBSAN_OPTIONS=", "LSAN_OPTIONS=", "TSAN_OPTIONS="};
    static char locale[] = "LC_ALL=C";
    size_t count = 0;
    chosen[count++] = locale;
    for (char **entry = environ; entry != NULL && *entry != NULL; entry++) {
        for (size_t i = 0; i < sizeof allowed / sizeof allowed[0]; i++) {
            if (count < UMBS_CHILD_ENVIRONMENT_MAX - 1 &&
                strncmp(*entry, allowed[i], strlen(allowed[i])) == 0) {
                chosen[count++] = *entry;
            }
        }
    }
    chosen[count] = NULL;
}

int umbs_child_own_group(pid_t parent)
{
    if (setpgid(0, 0) != 0 || prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0) != 0) {
        return -1;
    }
    return getppid() == parent ? 0 : -1; /* the parent may have died before the line above */
}

int umbs_child_lay_out(int *sources, int count)
{
    const int nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
    for (int i = 0; i < count; i++) {
        sources[i] = fcntl(sources[i] < 0 ? nothing : sources[i], F_DUPFD, FD_SPARE);
        if (sources[i] < 0) {
            return -1;
        }
    }
    for (int i = 0; i < count; i++) {
        if (dup2(sources[i], i) < 0) {
            return -1;
        }
    }
    return close_range((unsigned)count, ~0U, 0);
}

int umbs_child_limit(int resource, uint64_t soft, uint64_t hard)
{
    struct rlimit value;
    if (getrlimit((__rlimit_resource_t)resource, &value) != 0) {
        return -1;
    }
    if (value.rlim_max != RLIM_INFINITY && hard > value.rlim_max) {
        hard = value.rlim_max;
    }
    value.rlim_cur = soft < hard ? soft : hard;
    value.rlim_max = hard;
    return setrlimit((__rlimit_resource_t)resource, &value);
}

int umbs_child_reset_signals(void)
{
    struct sigaction action = {.sa_handler = SIG_DFL};
    sigset_t none;
    sigemptyset(&action.sa_mask);
    sigemptyset(&none);
    for (int number = 1; number < 32; number++) {
        if (number != SIGKILL && number != SIGSTOP) {
            (void)sigaction(number, &action, NULL);
        }
    }
    return sigprocmask(SIG_SETMASK, &none, NULL);
}

int umbs_child_has_ended(pid_t child)
{
    siginfo_t facts = {0};
    int code = waitid(P_PID, (id_t)child, &facts, WEXITED | WNOHANG | WNOWAIT);
    return code == 0 ? facts.si_pid == child : errno != EINTR;
}

int umbs_child_reap(pid_t child, int *exit_code, int *signal)
{
    int status = 0;
    pid_t ended;
    (void)kill(-child, SIGKILL);
    do {
        ended = waitpid(child, &status, 0);
    } while (ended < 0 && errno == EINTR);
    *exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    *signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    return ended == child;
}

void umbs_standard_streams_open(void)
{
    int fd = 0;
    while (fd >= 0 && fd <= STDERR_FILENO) { /* open takes the lowest free number each time */
        fd = open("/dev/null", O_RDWR);
    }
    if (fd > STDERR_FILENO) {
        close(fd);
    }
}
