/* All that a program needs of the firmware, linked with nothing else: what it takes in flash, and that it needs no
   library but the compiler's own. */
#include "boat.h"

extern const boat_config flash_config;
extern const boat_hardware flash_hardware;
extern boat flash_board;

void flash_entry(const uint8_t *data, size_t n);

void flash_entry(const uint8_t *data, size_t n)
{
    boat_init(&flash_board, &flash_config, &flash_hardware, BOAT_POWER);
    for (;;) {
        boat_receive(&flash_board, data, n);
        boat_poll(&flash_board);
    }
}
