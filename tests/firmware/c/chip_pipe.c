/* pipe_board.c on an emulated Cortex-M3: standard input and output are the emulator's, by semihosting. */
#include <stdlib.h>

/* of start.c; nothing here lets them be called */
extern void nmi_handler(void);
extern void systick_handler(void);
extern void uart_receive_handler(void);

extern void initialise_monitor_handles(void);
extern int pipe_main(void); /* main of pipe_board.c */

void nmi_handler(void)
{
}

void systick_handler(void)
{
}

void uart_receive_handler(void)
{
}

int main(void)
{
    initialise_monitor_handles();
    exit(pipe_main());
}
