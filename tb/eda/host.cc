// A host in C++ that opens no device and computes a view.
#include <cstdio>
#include "splatcore_camera.h"
extern "C" {
void splatcore_write(void *device, uint32_t address, uint32_t value)
{
    static_cast<volatile uint32_t *>(device)[address / 4] = value;
}
uint32_t splatcore_read(void *device, uint32_t address)
{
    return static_cast<volatile uint32_t *>(device)[address / 4];
}
void splatcore_pause(void *) {}
}
int main()
{
    static uint32_t registers[1024];
    static const uint8_t model[1024] = {};
    const double background[3] = {};
    splatcore_camera camera = {};
    splatcore_view view = {};
    camera.fx = camera.fy = camera.width = camera.height = 8;
    splatcore_look(&view, &camera, model, background);
    std::printf("%d %u\n", splatcore_open(registers) == SPLATCORE_NO_DEVICE, view.width);
    std::printf("%d\n", SPLATCORE_WORK_BYTES(2, 3) - SPLATCORE_FEATURES_AT(2) >= SPLATCORE_ALIGNED(1));
    return 0;
}
