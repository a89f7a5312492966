/* In place of the lab's own part of the program: a table of zeros. */
#include "boat.h"

extern const boat_config flash_config;
extern const boat_hardware flash_hardware;
extern boat flash_board;

const boat_config flash_config = {0};
const boat_hardware flash_hardware = {0};
boat flash_board;
