/* Driver of Splatcore for a kernel or firmware, with integers only. Apache-2.0.
 *
 * C99, freestanding. Register values that depend on a camera come from splatcore_camera.c, which
 * runs in user space. The platform provides the first three functions and manages caches: data
 * written by the host must be in memory before START, and the image must be read from memory.
 */
#ifndef SPLATCORE_DRIVER_H
#define SPLATCORE_DRIVER_H

#include "splatcore.h"

#ifdef __cplusplus
extern "C" {
#endif

void splatcore_write(void *device, uint32_t address, uint32_t value); /* write a register */
uint32_t splatcore_read(void *device, uint32_t address); /* read a register */
void splatcore_pause(void *device); /* wait until the interrupt is high, for a limited time */

/* The interrupt is high while INTERRUPT has a bit that INTERRUPT_ENABLE has too. Each function that
 * waits sets INTERRUPT_ENABLE to the bits that it waits for, so that no other event ends its pauses
 * early; events that it does not wait for stay in INTERRUPT. */

/* Functions return 0 for success; the value of ERROR (from the lowest bit: code, detail, one bit
 * per half that has aborted a frame); or one of these, which are never values of ERROR. */
enum splatcore_failure {
    SPLATCORE_NO_DEVICE = -1, /* not the machine of splatcore.h */
    SPLATCORE_NO_FRAME = -2,  /* the image is too large for the machine, or empty */
    SPLATCORE_TIMEOUT = -3    /* waited too long; all frames have been aborted */
};

#if SPLATCORE_ADDRESS_BITS > 32
typedef uint64_t splatcore_address;
#else
typedef uint32_t splatcore_address;
#endif

/* Physical addresses, multiples of SPLATCORE_WORK_ALIGNMENT, of a packed model, two work areas,
 * scratch memory and an image; and capacity of each work area in list pages and features. No area
 * may cross a multiple of 4 GiB (else ERROR reports RANGE). */
struct splatcore_memory {
    splatcore_address model, work, scratch, image;
    uint32_t pages, features;
};

/* An image's size, and values for the registers from SPLATCORE_VIEW_AT on: background, camera. */
struct splatcore_view {
    uint32_t width, height;
    uint32_t words[SPLATCORE_VIEW_WORDS];
#ifdef SPLATCORE_FORMAT
    uint32_t format; /* 0: red, green, blue; or SPLATCORE_FORMAT_RGBA. splatcore_look sets 0 */
#endif
};

/* Returned if the bit ERROR of INTERRUPT is set but ERROR is 0. A write clears all of ERROR, so an
 * error that occurs while the driver reads and clears an earlier one may lose its code. Each half
 * may have aborted a frame; the value returned before may already include this error. */
#define SPLATCORE_ERROR_UNKNOWN \
    (SPLATCORE_ERROR_PREPROCESSING | SPLATCORE_ERROR_RENDERING)

/* Check that the device is the machine of splatcore.h; clear its events and ERROR, and disable its
 * interrupts, which the functions that wait enable. */
int32_t splatcore_open(void *device);

/* Wait for READY in STATUS, for at most `pauses` pauses; of INTERRUPT, clear only READY. */
int32_t splatcore_ready(void *device, uint32_t pauses);

/* Start a frame; READY in STATUS must be high. */
int32_t splatcore_start(void *device, const struct splatcore_memory *memory,
                        const struct splatcore_view *view);

/* Wait for one of the bits `events` of INTERRUPT, for at most `pauses` pauses, and clear those set.
 * An error ends the wait too: then ERROR and its bit are cleared, and other events stay. */
int32_t splatcore_wait(void *device, uint32_t events, uint32_t pauses);

/* Wait until FINISHED, the number of complete frames modulo 2^16, reaches `frames`, with at most
 * `pauses` pauses between two frames. With two frames in flight the bit FRAME is not enough: the
 * second frame may be complete before the host has cleared the bit set by the first. */
int32_t splatcore_finished(void *device, uint32_t frames, uint32_t pauses);

/* Render one frame into memory->image. If the lists need more than memory->pages pages, it is set
 * to the number needed, up to pages_max, and the frame is started again. No other frame may be in
 * flight: earlier events and errors are cleared. */
int32_t splatcore_frame(void *device, struct splatcore_memory *memory,
                        const struct splatcore_view *view, uint32_t pages_max, uint32_t pauses);

#ifdef __cplusplus
}
#endif

#endif
