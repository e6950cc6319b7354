/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Owner locks, see owner_lock.h. The file is one line, HOST BOOT PID WORD NUMBER; an empty file has
 * no owner.
 */
#define _GNU_SOURCE /* F_OFD_SETLK, getrandom */
#include "common/owner_lock.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "tool/clock.h"

#define LINE_SIZE (UMBS_OWNER_SIZE + 24)
#define LOOK_MS   100 /* between reads of a number that may stand still */

struct line {
    char text[LINE_SIZE];
};

/* The first word of a small file; "-" where it cannot be read. */
static void read_word(const char *path, char *word, size_t size)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    const ssize_t count = fd >= 0 ? read(fd, word, size - 1) : 0;
    word[count > 0 ? count : 0] = '\0';
    word[strcspn(word, " \n")] = '\0';
    if (word[0] == '\0') {
        (void)snprintf(word, size, "-");
    }
    umbs_hang_up(&fd);
}

static void name_self(char owner[UMBS_OWNER_SIZE])
{
    char host[128] = "-";
    char boot[64];
    uint64_t word = 0;
    (void)gethostname(host, sizeof host - 1);
    host[strcspn(host, " \n")] = '\0';
    read_word("/proc/sys/kernel/random/boot_id", boot, sizeof boot);
    if (getrandom(&word, sizeof word, 0) != (ssize_t)sizeof word) {
        word = umbu_clock_ns() << 20;
    }
    (void)snprintf(owner, UMBS_OWNER_SIZE, "%s %s %ld %016" PRIx64, host, boot, (long)getpid(),
                   word);
}

/* Takes both locks. Returns 1, 0 (another process has one) or -1 (the file system has no locks). */
static int lock_file(int fd)
{
    struct flock whole = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    const int flocked = flock(fd, LOCK_EX | LOCK_NB) == 0 ? 1 : errno == EWOULDBLOCK ? 0 : -1;
    if (flocked == 0) {
        return 0;
    }
    if (fcntl(fd, F_OFD_SETLK, &whole) != 0) {
        return errno == EAGAIN || errno == EACCES ? 0 : flocked;
    }
    return 1;
}

static struct line read_line(int fd)
{
    struct line line;
    const ssize_t count = pread(fd, line.text, sizeof line.text - 1, 0);
    line.text[count > 0 ? count : 0] = '\0';
    line.text[strcspn(line.text, "\n")] = '\0';
    return line;
}

/* Reads the line through a new descriptor, so that NFS shows the latest bytes (owner_lock.h). */
static struct line read_anew(const char *path)
{
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    const struct line line = fd >= 0 ? read_line(fd) : (struct line){""};
    umbs_hang_up(&fd);
    return line;
}

static enum umb_status is_taken(const char *path, const struct line *line, struct umb_error *error)
{
    char host[128];
    long pid = 0;
    if (sscanf(line->text, "%127s %*s %ld", host, &pid) != 2) {
        return umb_fail(error, UMB_E_BUSY, "another daemon uses '%.200s'", path);
    }
    return umb_fail(error, UMB_E_BUSY, "another daemon, pid %ld on host '%.100s', uses '%.200s'",
                    pid, host, path);
}

/* Returns 1 if the line's owner ran on this machine since the last boot. A process that holds the
 * lock then knows that this owner has ended. */
static int is_of_this_boot(const struct line *line, const char *owner)
{
    char theirs[64];
    char ours[64];
    return sscanf(line->text, "%*s %63s", theirs) == 1 && sscanf(owner, "%*s %63s", ours) == 1 &&
           strcmp(ours, "-") != 0 && strcmp(theirs, ours) == 0;
}

/* Watches the line. Returns 0 once the line changes, 1 if it stays the same for watch_ms. */
static int stands_still(const char *path, const struct line *before, uint32_t watch_ms)
{
    const struct timespec pause = {.tv_nsec = LOOK_MS * 1000000L};
    const int64_t until = umbu_clock_ms() + (int64_t)watch_ms;
    while (umbu_clock_ms() < until) {
        (void)nanosleep(&pause, NULL);
        const struct line now = read_anew(path);
        if (strcmp(now.text, before->text) != 0) {
            return now.text[0] == '\0'; /* the owner ended meanwhile */
        }
    }
    return 1;
}

static enum umb_status write_line(struct umbs_owner_lock *lock, struct umb_error *error)
{
    char text[LINE_SIZE];
    const int length = snprintf(text, sizeof text, "%s %" PRIu64 "\n", lock->owner, ++lock->number);
    if (pwrite(lock->fd, text, (size_t)length, 0) != length || ftruncate(lock->fd, length) != 0 ||
        (lock->beats && fsync(lock->fd) != 0)) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot write '%.200s'", lock->path);
    }
    return UMB_OK;
}

/* Returns 1 if the path still leads to the open file. The file may have been removed before it was
 * locked. */
static int is_at(int fd, const char *path)
{
    struct stat ours;
    struct stat there;
    return fstat(fd, &ours) == 0 && stat(path, &there) == 0 && ours.st_dev == there.st_dev &&
           ours.st_ino == there.st_ino;
}

/* Locks the open file, or fails with the reason. */
static enum umb_status take_open(struct umbs_owner_lock *lock, enum umbs_reach reach,
                                 uint32_t watch_ms, struct umb_error *error)
{
    const int locked = lock_file(lock->fd);
    const struct line before = read_line(lock->fd);
    if (locked == 0 || !is_at(lock->fd, lock->path)) {
        return is_taken(lock->path, &before, error);
    }
    lock->beats = reach != UMBS_REACH_LOCAL || locked < 0;
    if (lock->beats && before.text[0] != '\0' &&
        (locked < 0 || !is_of_this_boot(&before, lock->owner)) &&
        !stands_still(lock->path, &before, watch_ms)) {
        return is_taken(lock->path, &before, error);
    }
    const enum umb_status status = write_line(lock, error);
    /* Without beats, the line only names the owner of the locks. */
    return lock->beats ? status : UMB_OK;
}

enum umb_status umbs__owner_lock_take(const char *path, enum umbs_reach reach, uint32_t watch_ms,
                                      struct umbs_owner_lock *lock, struct umb_error *error)
{
    *lock = (struct umbs_owner_lock){.fd = -1};
    const int length = snprintf(lock->path, sizeof lock->path, "%s", path);
    if (length < 0 || (size_t)length >= sizeof lock->path) {
        return umb_fail(error, UMB_E_LIMIT, "a path of %d bytes is too long", length);
    }
    lock->fd = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (lock->fd < 0) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot lock '%.200s'", path);
    }
    name_self(lock->owner);
    enum umb_status status = take_open(lock, reach, watch_ms, error);
    if (status != UMB_OK) {
        umbs_hang_up(&lock->fd);
    }
    return status;
}

enum umb_status umbs_owner_lock_take(const char *path, struct umbs_owner_lock *lock,
                                     struct umb_error *error)
{
    const int fd = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0600);
    enum umbs_reach reach = UMBS_REACH_UNKNOWN;
    if (fd >= 0) {
        reach = umbs_file_system(fd, NULL);
        (void)close(fd);
    }
    return umbs__owner_lock_take(path, reach, UMBS_TAKE_OVER_MS, lock, error);
}

enum umb_status umbs_owner_lock_beat(struct umbs_owner_lock *lock, struct umb_error *error)
{
    if (lock->fd < 0 || !lock->beats) {
        return UMB_OK;
    }
    const struct line now = read_anew(lock->path);
    if (strncmp(now.text, lock->owner, strlen(lock->owner)) != 0) {
        return umb_fail(error, UMB_E_STATE, "'%.200s' was taken over by '%.150s'", lock->path,
                        now.text);
    }
    return write_line(lock, error);
}

int umbs_owner_lock_is_there(const struct umbs_owner_lock *lock)
{
    return lock->fd >= 0 && is_at(lock->fd, lock->path);
}

void umbs_owner_lock_release(struct umbs_owner_lock *lock)
{
    struct umb_error ignored;
    if (lock->fd < 0) {
        return;
    }
    if (umbs_owner_lock_beat(lock, &ignored) != UMB_E_STATE) {
        (void)!ftruncate(lock->fd, 0); /* a line that stays costs the next owner a wait */
    }
    umbs_hang_up(&lock->fd);
}
