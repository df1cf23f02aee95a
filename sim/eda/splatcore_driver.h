/* A driver of Splatcore, of whole numbers alone: for a kernel, or for firmware. Apache-2.0.
 *
 * C99, freestanding. What depends on a camera comes as register values, which splatcore_camera.c
 * makes in user space. The platform provides the first three functions. Caches are its matter too:
 * what the host has written must be in memory before START, and the image must be read from memory.
 */
#ifndef SPLATCORE_DRIVER_H
#define SPLATCORE_DRIVER_H

#include "splatcore.h"

#ifdef __cplusplus
extern "C" {
#endif

void splatcore_write(void *device, uint32_t address, uint32_t value); /* a register */
uint32_t splatcore_read(void *device, uint32_t address);
void splatcore_pause(void *device); /* until the interrupt is high, but a while at most */

/* What a function returns: 0, else ERROR's value (a code, above it a detail, above that the halves
 * that have given up a frame), else one of these, which no value of ERROR is. */
enum splatcore_failure {
    SPLATCORE_NO_DEVICE = -1, /* ID is another one, or the packed models that it takes are */
    SPLATCORE_NO_FRAME = -2,  /* the image is too large for the machine, or empty */
    SPLATCORE_TIMEOUT = -3    /* what is waited for has not come; frames have been given up */
};

#if SPLATCORE_ADDRESS_BITS > 32
typedef uint64_t splatcore_address;
#else
typedef uint32_t splatcore_address;
#endif

/* Physical addresses, multiples of SPLATCORE_WORK_ALIGNMENT: a packed model, two work areas, scratch
 * memory, an image; and what there is room for in each area: list pages, features. None of them may
 * cross a multiple of 4 GiB (ERROR says RANGE). */
struct splatcore_memory {
    splatcore_address model, work, scratch, image;
    uint32_t pages, features;
};

/* An image's size, and values of the registers from SPLATCORE_VIEW_AT on: background, camera. */
struct splatcore_view {
    uint32_t width, height;
    uint32_t words[SPLATCORE_VIEW_WORDS];
};

/* Check that there is the machine that splatcore.h is of; enable its interrupts. */
int32_t splatcore_open(void *device);

/* Wait for READY in STATUS, for so many pauses at most. */
int32_t splatcore_ready(void *device, uint32_t pauses);

/* Begin a frame; only while STATUS says READY. */
int32_t splatcore_start(void *device, const struct splatcore_memory *memory,
                        const struct splatcore_view *view);

/* Wait for one of these bits of INTERRUPT, for so many pauses at most. */
int32_t splatcore_wait(void *device, uint32_t events, uint32_t pauses);

/* Wait until FINISHED, the count of complete frames, has come to a value (both modulo 2^16), for so
 * many pauses at most between two of them. With two frames in flight FRAME alone does not do: the
 * second may be complete before the host has cleared the bit that the first has set. */
int32_t splatcore_finished(void *device, uint32_t frames, uint32_t pauses);

/* Render one frame into memory->image. Where lists need more pages than there are, so many are
 * taken, up to pages_max, and the frame is begun again. */
int32_t splatcore_frame(void *device, struct splatcore_memory *memory,
                        const struct splatcore_view *view, uint32_t pages_max, uint32_t pauses);

#ifdef __cplusplus
}
#endif

#endif
