/* Headers and drivers of two machines, with the prefixes `left` and `RIGHT`, in one program. */
#include <stdio.h>
#include "left_camera.h"
#include "RIGHT_camera.h"
void left_write(void *device, uint32_t address, uint32_t value)
{
    (void)device, (void)address, (void)value;
}
uint32_t left_read(void *device, uint32_t address) { (void)device; return address; }
void left_pause(void *device) { (void)device; }
void RIGHT_write(void *device, uint32_t address, uint32_t value)
{
    (void)device, (void)address, (void)value;
}
uint32_t RIGHT_read(void *device, uint32_t address) { (void)device; return address; }
void RIGHT_pause(void *device) { (void)device; }
int main(void)
{
    struct left_memory left = {0};
    struct RIGHT_memory right = {0};
    printf("%d %d\n", LEFT_WIDTH_MAX, RIGHT_WIDTH_MAX);
    printf("%d %d\n", (int)sizeof left.model, (int)sizeof right.model);
    printf("%d %d\n", (int)left_open(0), (int)RIGHT_open(0));
    return 0;
}
