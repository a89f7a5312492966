/* Start-up of a Cortex-M3: vectors, variables, and a stack filled with a pattern that shows how deep it was used. */
#include <stdint.h>

#define STACK_UNUSED 0xA5A5A5A5u

extern uint32_t _data_load[], _data[], _data_end[], _bss[], _bss_end[], _stack_limit[], _stack_top[];

extern int main(void);
void reset_handler(void);
void fault_handler(void);
void nmi_handler(void);
void systick_handler(void);
void uart_receive_handler(void);

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[] = {
    {.stack = _stack_top},
    {.handler = reset_handler},
    {.handler = nmi_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = fault_handler},
    {.handler = systick_handler},
    {.handler = uart_receive_handler}, /* interrupt 0; no other is enabled */
};

/* The watchdog ends this loop. */
__attribute__((weak)) void fault_handler(void)
{
    for (;;) {
    }
}

__attribute__((weak)) void nmi_handler(void)
{
    fault_handler();
}

__attribute__((weak)) void systick_handler(void)
{
    fault_handler();
}

__attribute__((weak)) void uart_receive_handler(void)
{
    fault_handler();
}

void reset_handler(void)
{
    volatile uint32_t *to;
    const uint32_t *from = _data_load;

    for (to = _data; to < _data_end; to++) {
        *to = *from++;
    }
    for (to = _bss; to < _bss_end; to++) {
        *to = 0u;
    }
    for (to = _stack_limit; to < (uint32_t *)__builtin_frame_address(0) - 16; to++) { /* not what is in use here */
        *to = STACK_UNUSED;
    }
    (void)main();
    fault_handler();
}
