/* A GenTL producer of rig's own, for tests: the C interface of EMVA GenTL 1.5 in front of one simulated camera.

It shows one system, one interface, one device and one stream. Registers are read and written by two functions
that the test gives to fixture_connect(), and frames come from fixture_deliver(). */

#include <errno.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define API __attribute__((visibility("default")))
#define MOST 64

enum { OK = 0, NOT_INITIALIZED = -1002, NOT_IMPLEMENTED = -1003, IN_USE = -1004, BAD_HANDLE = -1006,
       BAD_ID = -1007, BAD_PARAMETER = -1009, IO = -1010, TIMED_OUT = -1011, NOT_AVAILABLE = -1014,
       BAD_ADDRESS = -1015, TOO_SMALL = -1016, BAD_INDEX = -1017 };
enum { TEXT = 1, INT32 = 2, UINT32 = 3, UINT64 = 5, BOOL8 = 11, SIZE = 12 };

typedef int32_t (*Access)(uint64_t address, void *data, size_t size);
typedef struct { uint64_t block, timestamp, format, width, height, chunks, cut, kind, padding; } Meta;
typedef struct { uint8_t *memory; size_t size, filled; void *user; Meta meta; } Buffer;

static int tl, interface, device, port, stream, event; /* the addresses are the handles */
static int initialised, opened, grabbing, unplugged;
static char said[256];
static Access reader, writer;
static char url[128], serial[64];
static Buffer *buffers[MOST], store[MOST], *input[MOST], *output[MOST];
static int inputs, outputs;
static size_t payload; /* bytes of a frame, or 0: the device says it */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t filled = PTHREAD_COND_INITIALIZER;

static int32_t fail(int32_t code, const char *why)
{
    snprintf(said, sizeof said, "%s", why);
    return code;
}

static int32_t give(const void *value, size_t size, int32_t type, int32_t *told, void *out, size_t *room)
{
    if (told) *told = type;
    if (out && *room < size) return fail(TOO_SMALL, "the buffer is too small");
    if (out) memcpy(out, value, size);
    *room = size;
    return OK;
}

static int32_t text(const char *value, int32_t *told, void *out, size_t *room)
{
    return give(value, strlen(value) + 1, TEXT, told, out, room);
}

API void fixture_connect(Access read, Access write, const char *description, const char *number)
{
    reader = read;
    writer = write;
    unplugged = 0;
    snprintf(url, sizeof url, "%s", description);
    snprintf(serial, sizeof serial, "%s", number);
}

API void fixture_unplug(int gone) { unplugged = gone; }
API void fixture_size(size_t bytes) { payload = bytes; }
API int fixture_opened(void) { return opened; }

API int fixture_deliver(const uint8_t *data, size_t size, const Meta *meta)
{
    pthread_mutex_lock(&lock);
    int taken = grabbing && inputs;
    if (taken) {
        Buffer *buffer = input[0];
        memmove(input, input + 1, --inputs * sizeof *input);
        buffer->filled = size < buffer->size ? size : buffer->size;
        memcpy(buffer->memory, data, buffer->filled);
        buffer->meta = *meta;
        output[outputs++] = buffer;
        pthread_cond_signal(&filled);
    }
    pthread_mutex_unlock(&lock);
    return taken;
}

API int32_t GCInitLib(void)
{
    if (initialised) return fail(IN_USE, "it is initialised already");
    initialised = 1;
    return OK;
}

API int32_t GCCloseLib(void) { initialised = 0; return OK; }

API int32_t GCGetLastError(int32_t *code, char *out, size_t *room)
{
    *code = 0;
    return text(said, NULL, out, room);
}

API int32_t TLOpen(void **handle)
{
    if (!initialised) return fail(NOT_INITIALIZED, "GCInitLib comes first");
    if (unplugged) return fail(IO, "there is no answer");
    *handle = &tl;
    return OK;
}

API int32_t TLClose(void *handle) { return handle == &tl ? OK : BAD_HANDLE; }
API int32_t TLUpdateInterfaceList(void *handle, uint8_t *changed, uint64_t wait) { *changed = 0; return OK; }
API int32_t TLGetNumInterfaces(void *handle, uint32_t *count) { *count = 1; return OK; }

API int32_t TLGetInterfaceID(void *handle, uint32_t at, char *out, size_t *room)
{
    return at ? fail(BAD_INDEX, "there is one interface") : text("wire", NULL, out, room);
}

API int32_t TLOpenInterface(void *handle, const char *name, void **opened_interface)
{
    if (strcmp(name, "wire")) return fail(BAD_ID, "there is no such interface");
    *opened_interface = &interface;
    return OK;
}

API int32_t IFClose(void *handle) { return handle == &interface ? OK : BAD_HANDLE; }
API int32_t IFUpdateDeviceList(void *handle, uint8_t *changed, uint64_t wait) { *changed = 1; return OK; }
API int32_t IFGetNumDevices(void *handle, uint32_t *count) { *count = reader && !unplugged; return OK; }

API int32_t IFGetDeviceID(void *handle, uint32_t at, char *out, size_t *room)
{
    return at ? fail(BAD_INDEX, "there is one device") : text("camera", NULL, out, room);
}

API int32_t IFGetDeviceInfo(void *handle, const char *name, int32_t what, int32_t *told, void *out, size_t *room)
{
    switch (what) {
    case 1: return text("rig", told, out, room);
    case 2: return text("fixture", told, out, room);
    case 3: return text("U3V", told, out, room);
    case 7: return text(serial, told, out, room);
    }
    return fail(NOT_AVAILABLE, "not known");
}

API int32_t IFOpenDevice(void *handle, const char *name, int32_t flags, void **opened_device)
{
    if (unplugged) return fail(IO, "there is no answer");
    if (opened) return fail(IN_USE, "it is opened already");
    opened = 1;
    *opened_device = &device;
    return OK;
}

API int32_t DevClose(void *handle) { opened = 0; return handle == &device ? OK : BAD_HANDLE; }
API int32_t DevGetPort(void *handle, void **remote) { *remote = &port; return OK; }

API int32_t DevGetDataStreamID(void *handle, uint32_t at, char *out, size_t *room)
{
    return at ? fail(BAD_INDEX, "there is one stream") : text("frames", NULL, out, room);
}

API int32_t DevOpenDataStream(void *handle, const char *name, void **opened_stream)
{
    *opened_stream = &stream;
    return OK;
}

static int32_t access_port(Access act, void *handle, uint64_t address, void *data, size_t *size)
{
    if (handle != &port) return fail(BAD_HANDLE, "that is no port");
    if (unplugged) return fail(IO, "there is no answer");
    return act(address, data, *size) ? fail(BAD_ADDRESS, "the device refuses that address") : OK;
}

API int32_t GCReadPort(void *handle, uint64_t address, void *data, size_t *size)
{
    return access_port(reader, handle, address, data, size);
}

API int32_t GCWritePort(void *handle, uint64_t address, const void *data, size_t *size)
{
    return access_port(writer, handle, address, (void *)data, size);
}

API int32_t GCGetNumPortURLs(void *handle, uint32_t *count) { *count = 1; return OK; }

API int32_t GCGetPortURLInfo(void *handle, uint32_t at, int32_t what, int32_t *told, void *out, size_t *room)
{
    return what ? fail(NOT_AVAILABLE, "not known") : text(url, told, out, room);
}

API int32_t GCRegisterEvent(void *handle, int32_t kind, void **registered)
{
    if (handle != &stream || kind != 1) return fail(NOT_IMPLEMENTED, "there are new buffers only");
    *registered = &event;
    return OK;
}

API int32_t GCUnregisterEvent(void *handle, int32_t kind) { return handle == &stream ? OK : BAD_HANDLE; }

API int32_t EventGetData(void *handle, void *out, size_t *room, uint64_t milliseconds)
{
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += milliseconds / 1000;
    until.tv_nsec += milliseconds % 1000 * 1000000;
    if (until.tv_nsec >= 1000000000) until.tv_sec++, until.tv_nsec -= 1000000000;
    pthread_mutex_lock(&lock);
    int late = 0;
    while (!outputs && !late) late = pthread_cond_timedwait(&filled, &lock, &until) == ETIMEDOUT;
    int32_t code = TIMED_OUT;
    if (outputs) {
        void *data[2] = {output[0], output[0]->user};
        memmove(output, output + 1, --outputs * sizeof *output);
        code = give(data, sizeof data, 0, NULL, out, room);
    }
    pthread_mutex_unlock(&lock);
    return code == TIMED_OUT ? fail(code, "no buffer was filled") : code;
}

API int32_t EventFlush(void *handle) { return OK; }
API int32_t DSClose(void *handle) { return handle == &stream ? OK : BAD_HANDLE; }

API int32_t DSGetInfo(void *handle, int32_t what, int32_t *told, void *out, size_t *room)
{
    uint8_t defines = payload != 0;
    size_t least = 5;
    if (what == 7 && payload) return give(&payload, sizeof payload, SIZE, told, out, room);
    if (what == 9) return give(&defines, sizeof defines, BOOL8, told, out, room);
    if (what == 12) return give(&least, sizeof least, SIZE, told, out, room);
    return fail(NOT_AVAILABLE, "ask the device");
}

API int32_t DSAnnounceBuffer(void *handle, void *memory, size_t size, void *user, void **announced)
{
    for (int at = 0; at < MOST; at++)
        if (!buffers[at]) {
            buffers[at] = &store[at];
            *buffers[at] = (Buffer){.memory = memory, .size = size, .user = user};
            *announced = buffers[at];
            return OK;
        }
    return fail(BAD_PARAMETER, "there are too many buffers");
}

API int32_t DSRevokeBuffer(void *handle, void *buffer, void **memory, void **user)
{
    for (int at = 0; at < inputs; at++)
        if (input[at] == buffer) return fail(IN_USE, "it is queued");
    for (int at = 0; at < MOST; at++)
        if (buffers[at] == buffer) {
            *memory = buffers[at]->memory;
            *user = buffers[at]->user;
            buffers[at] = NULL;
            return OK;
        }
    return fail(BAD_HANDLE, "that is no buffer");
}

API int32_t DSQueueBuffer(void *handle, void *buffer)
{
    pthread_mutex_lock(&lock);
    int32_t code = OK;
    for (int at = 0; at < inputs; at++)
        if (input[at] == buffer) code = IN_USE;
    if (code == OK) input[inputs++] = buffer;
    pthread_mutex_unlock(&lock);
    return code == OK ? OK : fail(code, "it is queued already");
}

API int32_t DSFlushQueue(void *handle, int32_t what)
{
    if (what != 4) return fail(NOT_IMPLEMENTED, "all are discarded, or none");
    pthread_mutex_lock(&lock);
    inputs = outputs = 0;
    pthread_mutex_unlock(&lock);
    return OK;
}

API int32_t DSStartAcquisition(void *handle, int32_t flags, uint64_t count)
{
    if (grabbing) return fail(IN_USE, "it is started already");
    grabbing = 1;
    return OK;
}

API int32_t DSStopAcquisition(void *handle, int32_t flags)
{
    grabbing = 0;
    return OK;
}

API int32_t DSGetBufferInfo(void *handle, void *which, int32_t what, int32_t *told, void *out, size_t *room)
{
    const Buffer *buffer = which;
    const Meta *meta = &buffer->meta;
    size_t width = meta->width, height = meta->height, padding = meta->padding, none = 0;
    uint8_t chunks = meta->chunks, cut = meta->cut;
    switch (what) {
    case 3: return give(&meta->timestamp, 8, UINT64, told, out, room);
    case 7: return give(&cut, 1, BOOL8, told, out, room);
    case 9: return give(&buffer->filled, sizeof buffer->filled, SIZE, told, out, room);
    case 10: return give(&width, sizeof width, SIZE, told, out, room);
    case 11: return give(&height, sizeof height, SIZE, told, out, room);
    case 14: return give(&padding, sizeof padding, SIZE, told, out, room);
    case 16: return give(&meta->block, 8, UINT64, told, out, room);
    case 18: return give(&none, sizeof none, SIZE, told, out, room);
    case 19: return give(&meta->kind, 8, UINT64, told, out, room);
    case 20: return give(&meta->format, 8, UINT64, told, out, room);
    case 30: return give(&chunks, 1, BOOL8, told, out, room);
    }
    return fail(NOT_AVAILABLE, "not known");
}
