/* A library to be preloaded: the file operation number N below a folder fails, kills the process or signals it.

   Every operation of the C library that changes what is on a disk counts, and every opening of a file to be read;
   those of other folders do not. `faults_arm` says which one and how. Built and driven by fault_runs.py. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NONE, ONCE, GONE, FULL, KILL, SIGNAL }; /* one error; all from there on; no space from there on; ... */

static char folder[PATH_MAX];
static int record = -1, kind = NONE, detail; /* detail: an errno, or a signal */
static long number = -1, count;

/* Arm it. below: absolute. at: the operation, from 0. into: a descriptor that names of operations are written to. */
void faults_arm(const char *below, long at, int how, int what, int into) {
    strncpy(folder, below, sizeof folder - 1);
    number = at, kind = how, detail = what, record = into, count = 0;
}

long faults_count(void) { return count; }

#define REAL(name) static __typeof__(&name) real; if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static int is_below(int at, const char *path) {
    char whole[2 * PATH_MAX] = "";
    if (!folder[0] || !path) return 0;
    if (path[0] != '/') {
        char link[64];
        ssize_t size;
        snprintf(link, sizeof link, at == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", at);
        size = readlink(link, whole, PATH_MAX - 1);
        if (size < 0) return 0;
        whole[size] = 0;
        strncat(whole, "/", 2);
    }
    strncat(whole, path, PATH_MAX - 1);
    return !strncmp(whole, folder, strlen(folder));
}

static int is_open_below(int file) {
    char link[64], whole[PATH_MAX];
    ssize_t size;
    if (!folder[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    size = readlink(link, whole, sizeof whole - 1);
    if (size < 0) return 0;
    whole[size] = 0;
    return !strncmp(whole, folder, strlen(folder));
}

/* Counts one operation; whether it must fail, with errno set. takes: whether it takes space. Before a process is
   killed, *half is set: the caller does a part and asks again with `die`. */
static int fails(const char *name, const char *path, int takes, int *half) {
    long here = __sync_fetch_and_add(&count, 1);
    if (record >= 0) dprintf(record, "%s %s\n", name, path ? path : "");
    if (kind == NONE || here < number) return 0;
    if (here > number) {
        if (kind == GONE) { errno = EIO; return 1; }
        if (kind == FULL && takes) { errno = ENOSPC; return 1; }
        return 0;
    }
    if (half) *half = 1;
    if (kind == KILL && !half) raise(SIGKILL);
    if (kind == SIGNAL) { kill(getpid(), detail); if (half) *half = 0; return 0; }
    if (kind == KILL) return 1;
    if (kind == FULL && !takes) { if (half) *half = 0; return 0; }
    errno = kind == FULL ? ENOSPC : kind == GONE ? EIO : detail;
    return 1;
}

static int dies(void) { int kept = errno; if (kind == KILL) raise(SIGKILL); errno = kept; return -1; }

static int opens(const char *name, int at, const char *path, int flags) {
    int writes = (flags & O_ACCMODE) != O_RDONLY || (flags & (O_CREAT | O_TRUNC));
    if (!is_below(at, path)) return 0;
    if (!writes && (flags & O_DIRECTORY)) return 0;
    return fails(writes ? name : "read", path, writes && (flags & O_CREAT), NULL);
}

#define MODE mode_t mode = 0; if (flags & (O_CREAT | __O_TMPFILE)) { va_list more; va_start(more, flags); mode = va_arg(more, mode_t); va_end(more); }

int open(const char *path, int flags, ...) { MODE REAL(open); return opens("open", AT_FDCWD, path, flags) ? -1 : real(path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE REAL(open64); return opens("open", AT_FDCWD, path, flags) ? -1 : real(path, flags, mode); }
int openat(int at, const char *path, int flags, ...) { MODE REAL(openat); return opens("open", at, path, flags) ? -1 : real(at, path, flags, mode); }
int openat64(int at, const char *path, int flags, ...) { MODE REAL(openat64); return opens("open", at, path, flags) ? -1 : real(at, path, flags, mode); }

static int fopens(const char *path, const char *mode) {
    return opens("open", AT_FDCWD, path, mode[0] == 'r' && !strchr(mode, '+') ? O_RDONLY : O_WRONLY | O_CREAT);
}
FILE *fopen(const char *path, const char *mode) { REAL(fopen); return fopens(path, mode) ? NULL : real(path, mode); }
FILE *fopen64(const char *path, const char *mode) { REAL(fopen64); return fopens(path, mode) ? NULL : real(path, mode); }

ssize_t write(int file, const void *data, size_t size) {
    int half = 0;
    REAL(write);
    if (is_open_below(file) && fails("write", "", 1, &half)) {
        int kept = errno;
        if (half && size > 1) real(file, data, size / 2);
        errno = kept;
        return dies();
    }
    return real(file, data, size);
}
ssize_t pwrite64(int file, const void *data, size_t size, off64_t place) {
    REAL(pwrite64);
    return is_open_below(file) && fails("write", "", 1, NULL) ? -1 : real(file, data, size, place);
}
ssize_t writev(int file, const struct iovec *parts, int number_of) {
    REAL(writev);
    return is_open_below(file) && fails("write", "", 1, NULL) ? -1 : real(file, parts, number_of);
}
size_t fwrite(const void *data, size_t size, size_t items, FILE *file) {
    int half = 0;
    REAL(fwrite);
    if (is_open_below(fileno(file)) && fails("write", "", 1, &half)) {
        int kept = errno;
        if (half && items > 1) { real(data, size, items / 2, file); fflush(file); }
        errno = kept;
        dies();
        return 0;
    }
    return real(data, size, items, file);
}
ssize_t sendfile64(int out, int in, off64_t *offset, size_t size) {
    REAL(sendfile64);
    return is_open_below(out) && fails("write", "", 1, NULL) ? -1 : real(out, in, offset, size);
}
ssize_t copy_file_range(int in, off64_t *from, int out, off64_t *to, size_t size, unsigned flags) {
    REAL(copy_file_range);
    return is_open_below(out) && fails("write", "", 1, NULL) ? -1 : real(in, from, out, to, size, flags);
}
int ftruncate64(int file, off64_t size) { REAL(ftruncate64); return is_open_below(file) && fails("truncate", "", 1, NULL) ? -1 : real(file, size); }
int ftruncate(int file, off_t size) { REAL(ftruncate); return is_open_below(file) && fails("truncate", "", 1, NULL) ? -1 : real(file, size); }
int fsync(int file) { REAL(fsync); return is_open_below(file) && fails("fsync", "", 1, NULL) ? -1 : real(file); }
int fdatasync(int file) { REAL(fdatasync); return is_open_below(file) && fails("fsync", "", 1, NULL) ? -1 : real(file); }

int mkdir(const char *path, mode_t mode) { REAL(mkdir); return is_below(AT_FDCWD, path) && fails("mkdir", path, 1, NULL) ? -1 : real(path, mode); }
int mkdirat(int at, const char *path, mode_t mode) { REAL(mkdirat); return is_below(at, path) && fails("mkdir", path, 1, NULL) ? -1 : real(at, path, mode); }
int rmdir(const char *path) { REAL(rmdir); return is_below(AT_FDCWD, path) && fails("rmdir", path, 0, NULL) ? -1 : real(path); }
int unlink(const char *path) { REAL(unlink); return is_below(AT_FDCWD, path) && fails("unlink", path, 0, NULL) ? -1 : real(path); }
int unlinkat(int at, const char *path, int flags) { REAL(unlinkat); return is_below(at, path) && fails("unlink", path, 0, NULL) ? -1 : real(at, path, flags); }
int remove(const char *path) { REAL(remove); return is_below(AT_FDCWD, path) && fails("unlink", path, 0, NULL) ? -1 : real(path); }
int rename(const char *from, const char *to) { REAL(rename); return is_below(AT_FDCWD, to) && fails("rename", to, 0, NULL) ? -1 : real(from, to); }
int renameat(int at, const char *from, int into, const char *to) { REAL(renameat); return is_below(into, to) && fails("rename", to, 0, NULL) ? -1 : real(at, from, into, to); }
int renameat2(int at, const char *from, int into, const char *to, unsigned flags) { REAL(renameat2); return is_below(into, to) && fails("rename", to, 0, NULL) ? -1 : real(at, from, into, to, flags); }
int symlink(const char *to, const char *path) { REAL(symlink); return is_below(AT_FDCWD, path) && fails("link", path, 1, NULL) ? -1 : real(to, path); }
int link(const char *from, const char *path) { REAL(link); return is_below(AT_FDCWD, path) && fails("link", path, 1, NULL) ? -1 : real(from, path); }
