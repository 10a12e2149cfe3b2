/* A V4L2 camera in user space, to be preloaded: what a kernel driver answers, at /dev/video77.
 *
 * Built against the kernel's own header, so that whoever drives it has the true structures and
 * numbers of requests. Its images are noise, but those in YUYV, which are grey by their number. It
 * counts as drivers do: an image that finds no buffer has a number too. From the environment:
 *   V4L2_CODE   its one coding: BGR3, YUYV with 32 bytes after each line, or MJPG from V4L2_FILE,
 *               where %ld is the number modulo 16
 *   V4L2_RATE   images a second (50)
 *   V4L2_SKIP   a number that is never delivered      V4L2_BAD    one that is damaged
 *   V4L2_STALL  no image from this number on          V4L2_GONE   unplugged from here on
 *   V4L2_SAME   images equal from here on             V4L2_SHORT  images cut short from here on
 *   V4L2_CLOCK  1: stamps of the time of day          V4L2_STEP   steps of the gain (1)
 *   V4L2_BARE   1: no control but the exposure        V4L2_KEEP   1: that stays automatic
 *   V4L2_WAIT   1: an image waits for a free buffer, so that a busy machine loses none
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define NODE "/dev/video77"
#define MOST 8

static int node = -1;
static int streaming, gone, count, width = 640, height = 480, hz;
static uint32_t sequence;
static void *memory[MOST];
static struct v4l2_buffer made[MOST];
static int waiting[MOST], ready[MOST], n_waiting, n_ready;
static pthread_t thread;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static struct { uint32_t id; int first, least, most, value; } controls[] = {
    {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY, 0, 3},
    {V4L2_CID_EXPOSURE_ABSOLUTE, 156, 1, 5000},
    {V4L2_CID_GAIN, 0, 0, 100},
    {V4L2_CID_AUTOGAIN, 1, 0, 1},
    {V4L2_CID_AUTO_WHITE_BALANCE, 1, 0, 1},
    {V4L2_CID_WHITE_BALANCE_TEMPERATURE, 4600, 2800, 6500},
};

static long set(const char *name, long otherwise) {
    const char *value = getenv(name);
    return value ? atol(value) : otherwise;
}

static uint32_t code(void) {
    const char *name = getenv("V4L2_CODE");
    if (!name) name = "BGR3";
    return v4l2_fourcc(name[0], name[1], name[2], name[3]);
}

static size_t line(void) { return code() == V4L2_PIX_FMT_YUYV ? width * 2 + 32 : width * 3; }

static size_t size(void) { return line() * height; }

/* Whether a number is, or lies beyond, the one of a setting. */
static int is(long number, const char *name) { return number == set(name, -1); }

static int from(long number, const char *name) { return set(name, -1) >= 0 && number >= set(name, -1); }

static size_t draw(uint64_t *to, long number) {
    static uint64_t state = 88172645463325252u;
    if (code() == V4L2_PIX_FMT_YUYV) {
        memset(to, 255, size());
        for (int y = 0; y < height; y++)
            for (int x = 0; x < width; x++) {
                uint8_t *pixel = (uint8_t *)to + y * line() + 2 * x;
                pixel[0] = 16 + number % 200;
                pixel[1] = 128;
            }
        return size();
    }
    if (code() == V4L2_PIX_FMT_MJPEG) {
        char name[4096];
        snprintf(name, sizeof name, getenv("V4L2_FILE"), number % 16);
        FILE *file = fopen(name, "rb");
        size_t n = fread(to, 1, size(), file);
        fclose(file);
        return n;
    }
    if (from(number, "V4L2_SAME")) state = 1;
    for (size_t i = 0; i < size() / 8; i++) {
        state ^= state << 13; state ^= state >> 7; state ^= state << 17;
        to[i] = state;
    }
    return size();
}

static void *run(void *nothing) {
    struct timespec due, now;
    uint64_t one = 1;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (streaming) {
        due.tv_nsec += 1000000000 / hz;
        due.tv_sec += due.tv_nsec / 1000000000;
        due.tv_nsec %= 1000000000;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        pthread_mutex_lock(&lock);
        int early = set("V4L2_WAIT", 0) && !n_waiting;
        long number = early ? -1 : (long)sequence++;
        if (from(number, "V4L2_GONE")) gone = 1;
        int silent = is(number, "V4L2_SKIP") || from(number, "V4L2_STALL");
        if (!gone && !silent && !early && n_waiting) {
            int k = waiting[0];
            memmove(waiting, waiting + 1, --n_waiting * sizeof *waiting);
            size_t used = draw(memory[k], number);
            clock_gettime(set("V4L2_CLOCK", 0) ? CLOCK_REALTIME : CLOCK_MONOTONIC, &now);
            struct v4l2_buffer *b = &made[k];
            b->sequence = number;
            b->bytesused = from(number, "V4L2_SHORT") ? 100 : used;
            b->flags = set("V4L2_CLOCK", 0) ? 0 : V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
            if (is(number, "V4L2_BAD")) b->flags |= V4L2_BUF_FLAG_ERROR;
            b->timestamp.tv_sec = now.tv_sec;
            b->timestamp.tv_usec = now.tv_nsec / 1000;
            ready[n_ready++] = k;
            if (write(node, &one, 8) != 8) abort();
        }
        pthread_mutex_unlock(&lock);
    }
    return nothing;
}

static int stream(int on) {
    if (on == streaming) return 0;
    streaming = on;
    if (on) return pthread_create(&thread, NULL, run, NULL) ? -1 : 0;
    pthread_join(thread, NULL);
    uint64_t old;
    while (read(node, &old, 8) == 8) ;
    n_waiting = n_ready = 0;
    return 0;
}

static int fail(int why) { errno = why; return -1; }

static int control(struct v4l2_control *asked, int write_it) {
    for (size_t i = 0; i < sizeof controls / sizeof *controls; i++) {
        if (controls[i].id != asked->id) continue;
        if (set("V4L2_BARE", 0) && i > 1) break;
        if (!write_it) { asked->value = controls[i].value; return 0; }
        int value = asked->value;
        if (value < controls[i].least) value = controls[i].least;
        if (value > controls[i].most) value = controls[i].most;
        if (asked->id == V4L2_CID_EXPOSURE_ABSOLUTE && controls[0].value != V4L2_EXPOSURE_MANUAL)
            return fail(EACCES); /* not while it is automatic */
        if (asked->id == V4L2_CID_WHITE_BALANCE_TEMPERATURE && controls[4].value)
            return fail(EACCES);
        if (asked->id == V4L2_CID_EXPOSURE_AUTO && set("V4L2_KEEP", 0)) return fail(EINVAL);
        if (asked->id == V4L2_CID_GAIN) value -= value % set("V4L2_STEP", 1);
        controls[i].value = value;
        return 0;
    }
    return fail(EINVAL);
}

static int answer(unsigned long request, void *with) {
    if (gone) return fail(ENODEV);
    switch (request) {
    case VIDIOC_QUERYCAP: {
        struct v4l2_capability *c = with;
        memset(c, 0, sizeof *c);
        strcpy((char *)c->driver, "user space");
        strcpy((char *)c->card, "A camera");
        c->device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        c->capabilities = c->device_caps | V4L2_CAP_DEVICE_CAPS;
        return 0;
    }
    case VIDIOC_G_FMT:
    case VIDIOC_S_FMT: {
        struct v4l2_format *f = with;
        if (request == VIDIOC_S_FMT && !streaming) {
            width = f->fmt.pix.width < 1280 ? 640 : 1280; /* its sizes */
            height = width == 640 ? 480 : 720;
        }
        f->fmt.pix.width = width;
        f->fmt.pix.height = height;
        f->fmt.pix.pixelformat = code();
        f->fmt.pix.bytesperline = line();
        f->fmt.pix.sizeimage = size();
        return 0;
    }
    case VIDIOC_G_PARM:
    case VIDIOC_S_PARM: {
        struct v4l2_streamparm *p = with;
        hz = set("V4L2_RATE", 50); /* its one rate */
        p->parm.capture.timeperframe.numerator = 1;
        p->parm.capture.timeperframe.denominator = hz;
        return 0;
    }
    case VIDIOC_REQBUFS: {
        struct v4l2_requestbuffers *r = with;
        stream(0);
        count = r->count = r->count > MOST ? MOST : r->count;
        return 0;
    }
    case VIDIOC_QUERYBUF:
    case VIDIOC_QBUF: {
        struct v4l2_buffer *b = with;
        int k = b->index;
        if (k >= count) return fail(EINVAL);
        pthread_mutex_lock(&lock);
        if (request == VIDIOC_QBUF) {
            waiting[n_waiting++] = k;
        } else {
            memset(&made[k], 0, sizeof made[k]);
            made[k].index = k;
            made[k].type = b->type;
            made[k].memory = b->memory;
            made[k].length = size();
            made[k].m.offset = k << 24;
            *b = made[k];
        }
        pthread_mutex_unlock(&lock);
        return 0;
    }
    case VIDIOC_DQBUF: {
        uint64_t one;
        if (read(node, &one, 8) != 8) return fail(EAGAIN);
        pthread_mutex_lock(&lock);
        *(struct v4l2_buffer *)with = made[ready[0]];
        memmove(ready, ready + 1, --n_ready * sizeof *ready);
        pthread_mutex_unlock(&lock);
        return 0;
    }
    case VIDIOC_STREAMON: return stream(1);
    case VIDIOC_STREAMOFF: return stream(0);
    case VIDIOC_G_CTRL: return control(with, 0);
    case VIDIOC_S_CTRL: return control(with, 1);
    case VIDIOC_QUERYCTRL: {
        struct v4l2_queryctrl *q = with;
        struct v4l2_control asked = {q->id, 0};
        for (size_t i = 0; i < sizeof controls / sizeof *controls; i++)
            if (controls[i].id == q->id) {
                q->minimum = controls[i].least;
                q->maximum = controls[i].most;
                q->step = q->id == V4L2_CID_GAIN ? set("V4L2_STEP", 1) : 1;
                q->flags = 0;
            }
        return control(&asked, 0);
    }
    }
    return fail(ENOTTY);
}

static int opened(const char *path, int flags, mode_t mode, const char *name) {
    if (strcmp(path, NODE)) {
        int (*real)(const char *, int, ...) = dlsym(RTLD_NEXT, name);
        return real(path, flags, mode);
    }
    if (node >= 0) return fail(EBUSY);
    for (size_t i = 0; i < sizeof controls / sizeof *controls; i++)
        controls[i].value = controls[i].first;
    gone = sequence = 0;
    width = 640, height = 480;
    return node = eventfd(0, EFD_NONBLOCK | EFD_SEMAPHORE);
}

int open(const char *path, int flags, ...) {
    va_list more;
    va_start(more, flags);
    mode_t mode = va_arg(more, mode_t);
    va_end(more);
    return opened(path, flags, mode, "open");
}

int open64(const char *path, int flags, ...) {
    va_list more;
    va_start(more, flags);
    mode_t mode = va_arg(more, mode_t);
    va_end(more);
    return opened(path, flags, mode, "open64");
}

int ioctl(int fd, unsigned long request, ...) {
    va_list more;
    va_start(more, request);
    void *with = va_arg(more, void *);
    va_end(more);
    if (fd == node && fd >= 0) return answer(request, with);
    int (*real)(int, unsigned long, ...) = dlsym(RTLD_NEXT, "ioctl");
    return real(fd, request, with);
}

static void *mapped(void *at, size_t length, int protection, int flags, int fd, off_t offset,
                    const char *name) {
    void *(*real)(void *, size_t, int, int, int, off_t) = dlsym(RTLD_NEXT, name);
    if (fd != node || fd < 0) return real(at, length, protection, flags, fd, offset);
    return memory[offset >> 24] =
               real(NULL, length, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
}

void *mmap(void *at, size_t length, int protection, int flags, int fd, off_t offset) {
    return mapped(at, length, protection, flags, fd, offset, "mmap");
}

void *mmap64(void *at, size_t length, int protection, int flags, int fd, off_t offset) {
    return mapped(at, length, protection, flags, fd, offset, "mmap64");
}

int poll(struct pollfd *fds, nfds_t n, int timeout) {
    int (*real)(struct pollfd *, nfds_t, int) = dlsym(RTLD_NEXT, "poll");
    if (n == 1 && fds->fd == node && gone) {
        fds->revents = POLLERR | POLLHUP;
        return 1;
    }
    return real(fds, n, timeout);
}

int close(int fd) {
    if (fd == node && fd >= 0) {
        stream(0);
        node = -1;
    }
    int (*real)(int) = dlsym(RTLD_NEXT, "close");
    return real(fd);
}
