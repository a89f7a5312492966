/* pipe_board.c on an emulated Cortex-M3: standard input and output are the emulator's, by semihosting. */
#include <stdlib.h>

extern void initialise_monitor_handles(void);
extern int pipe_main(void); /* main of pipe_board.c */

int main(void)
{
    initialise_monitor_handles();
    exit(pipe_main());
}
