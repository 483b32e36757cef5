/* A disk whose writes fail, for a program that loads this before its C library: from a call on, or once, those that
 * change files below a folder return an error. A full disk, a quota or a limit for the size of files refuses only what
 * extends or creates a file; a failing device (EIO) refuses everything. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char folder[4096];
static long calls, first;
static int error, once;

/* Fail from the given call on, or count only if it is 0. */
void failing_disk(const char *path, long from, int number, int only_once) {
    snprintf(folder, sizeof folder, "%s", path);
    first = from, error = number, once = only_once, calls = 0;
}

long failing_disk_calls(void) { return calls; }

static int fails(const char *path) {
    if (!folder[0] || strncmp(path, folder, strlen(folder))) return 0;
    long call = __sync_add_and_fetch(&calls, 1);
    if (!first || call < first || (once && call > first)) return 0;
    errno = error;
    return 1;
}

static int fails_at(int file) {
    char link[64], path[4096];
    if (!folder[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t size = readlink(link, path, sizeof path - 1);
    if (size <= 0) return 0;
    path[size] = 0;
    return fails(path);
}

/* Whether a full disk still accepts this: it only refuses to extend files. */
static int is_kept(int file, off_t end) {
    struct stat found;
    return error != EIO && !fstat(file, &found) && end <= found.st_size;
}

static off_t end_of(int file, size_t size) {
    if (fcntl(file, F_GETFL) & O_APPEND) return lseek(file, 0, SEEK_END) + (off_t)size;
    return lseek(file, 0, SEEK_CUR) + (off_t)size;
}

#define REAL(name) ((typeof(&name))dlsym(RTLD_NEXT, #name))
#define WRAP(type, name, end, arguments, values) \
    type name arguments { return fails_at(file) && !is_kept(file, end) ? -1 : REAL(name) values; }

WRAP(ssize_t, write, end_of(file, size), (int file, const void *data, size_t size), (file, data, size))
WRAP(ssize_t, pwrite, at + size, (int file, const void *data, size_t size, off_t at), (file, data, size, at))
WRAP(ssize_t, pwrite64, at + size, (int file, const void *data, size_t size, off64_t at), (file, data, size, at))
WRAP(int, fsync, 0, (int file), (file))
WRAP(int, fdatasync, 0, (int file), (file))
WRAP(int, ftruncate, size, (int file, off_t size), (file, size))
WRAP(int, ftruncate64, size, (int file, off64_t size), (file, size))

int posix_fallocate(int file, off_t at, off_t size) {
    return fails_at(file) && !is_kept(file, at + size) ? error : REAL(posix_fallocate)(file, at, size);
}

int posix_fallocate64(int file, off64_t at, off64_t size) {
    return fails_at(file) && !is_kept(file, at + size) ? error : REAL(posix_fallocate64)(file, at, size);
}

int rename(const char *from, const char *to) {
    return fails(to) && error == EIO ? -1 : REAL(rename)(from, to);
}

static int opens(const char *name, const char *path, int flags, va_list list) {
    int mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(list, int) : 0;
    if (flags & O_CREAT && access(path, F_OK) && fails(path)) return -1;
    return ((int (*)(const char *, int, ...))dlsym(RTLD_NEXT, name))(path, flags, mode);
}

int open(const char *path, int flags, ...) {
    va_list list;
    va_start(list, flags);
    int file = opens("open", path, flags, list);
    va_end(list);
    return file;
}

int open64(const char *path, int flags, ...) {
    va_list list;
    va_start(list, flags);
    int file = opens("open64", path, flags, list);
    va_end(list);
    return file;
}
