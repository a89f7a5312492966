/* Start-up of a Cortex-M3: vectors, variables, and a stack filled with a pattern that shows how deep it was used. */
#include <stdint.h>

#define STACK_UNUSED 0xA5A5A5A5u

/* of mps2.ld */
extern const uint32_t _data_load[];
extern uint32_t _data[];
extern uint32_t _data_end[];
extern uint32_t _bss[];
extern uint32_t _bss_end[];
extern uint32_t _stack_limit[];
extern uint32_t _stack_unused_end[]; /* what is above is in use by `reset_handler` */
extern uint32_t _stack_top[];

/* of the program */
extern int main(void);
extern void nmi_handler(void);
extern void systick_handler(void);
extern void uart_receive_handler(void);

extern void reset_handler(void);

/* The watchdog ends this loop. */
static void fault_handler(void)
{
    for (;;) {
    }
}

/* The processor's table begins with an address among its functions. */
typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[] = {
    {.stack = _stack_top},
    {.handler = reset_handler},
    {.handler = nmi_handler},
    {.handler = fault_handler}, /* hard fault, which the others become: none is enabled */
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

static void fill(volatile uint32_t *begin, const volatile uint32_t *end, uint32_t value)
{
    volatile uint32_t *at = begin;

    while (at != end) {
        *at = value;
        at = &at[1];
    }
}

void reset_handler(void)
{
    volatile uint32_t *to = _data;
    const uint32_t *from = _data_load;

    while (to != _data_end) {
        *to = *from;
        to = &to[1];
        from = &from[1];
    }
    fill(_bss, _bss_end, 0u);
    fill(_stack_limit, _stack_unused_end, STACK_UNUSED);
    (void)main();
    fault_handler();
}
