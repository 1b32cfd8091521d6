/* SPDX-License-Identifier: Apache-2.0
   A disk that loses what it was not made to take, preloaded into a process: whatever fsync and
   fdatasync are called for is copied, as it is then, to the folder KEPT. Of a file whose name no
   sync of its folder has written down, a loss of power leaves nothing. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void copy(int from, const char *name) {
    char part[4096], whole[4096], buffer[1 << 16];
    snprintf(part, sizeof part, "%s/.%s", getenv("KEPT"), name);
    snprintf(whole, sizeof whole, "%s/%s", getenv("KEPT"), name);
    int to = open(part, O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ssize_t size;
    for (off_t at = 0; (size = pread(from, buffer, sizeof buffer, at)) > 0; at += size)
        if (write(to, buffer, size) != size) abort();
    close(to);
    rename(part, whole);
}

static void note_names(const char *folder) {
    char path[4096];
    DIR *entries = opendir(folder);
    for (struct dirent *entry; entries && (entry = readdir(entries));) {
        snprintf(path, sizeof path, "%s/names/%s", getenv("KEPT"), entry->d_name);
        if (entry->d_name[0] != '.') close(open(path, O_WRONLY | O_CREAT, 0644));
    }
    if (entries) closedir(entries);
}

static void keep(int descriptor) {
    char link[64], path[4096];
    struct stat about;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t size = readlink(link, path, sizeof path - 1);
    if (!getenv("KEPT") || size < 0 || fstat(descriptor, &about)) return;
    path[size] = 0;
    if (S_ISDIR(about.st_mode)) {
        note_names(path);
        return;
    }
    int from = open(link, O_RDONLY);
    copy(from, strrchr(path, '/') + 1);
    close(from);
}

static int taken(const char *call, int descriptor) {
    int (*system)(int) = (int (*)(int))dlsym(RTLD_NEXT, call);
    keep(descriptor);
    return system(descriptor);
}

int fsync(int descriptor) { return taken("fsync", descriptor); }
int fdatasync(int descriptor) { return taken("fdatasync", descriptor); }
