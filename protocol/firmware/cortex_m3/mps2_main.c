/* The lab's own part on an emulated Cortex-M3, the machine mps2-an385 of QEMU: UART, clock and watchdog of the machine,
   and a simulated actuator in place of sensors, pumps and valve.

   The actuator is in RAM that a reset keeps, as a bladder keeps its air: `actuator` is what a debugger reads, and where
   it sets a fault. */
#include "boat.h"

/* ---- the machine's registers ------------------------------------------------------------------------------------- */

#define CLOCK_HZ 25000000u
#define REGISTER(address) (*(volatile uint32_t *)(address))

#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CONTROL REGISTER(0x40004008u)
#define UART_INTERRUPT_CLEAR REGISTER(0x4000400Cu)
#define UART_DIVIDER REGISTER(0x40004010u)
#define UART_TRANSMIT_FULL 1u
#define UART_ENABLE_ALL 0xBu /* transmitter, receiver, interrupt of the receiver */
#define UART_RECEIVE_INTERRUPT 2u
#define UART_BAUD 921600u

#define WATCHDOG_LOAD REGISTER(0x40008000u)
#define WATCHDOG_CONTROL REGISTER(0x40008008u)
#define WATCHDOG_CLEAR REGISTER(0x4000800Cu)
#define WATCHDOG_ENABLE_ALL 3u /* non-maskable interrupt after one period, reset after two */
#define WATCHDOG_PERIOD_MS 125u

#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define SYSTICK_ENABLE_ALL 7u /* counter, interrupt, the processor's own clock */
#define TICKS_PER_MS (CLOCK_HZ / 1000u)
#define TICKS_PER_US (CLOCK_HZ / 1000000u)

#define INTERRUPTS_ENABLE REGISTER(0xE000E100u)

static boat_config config = {
    .fw_major = 1,
    .fw_minor = 0,
    .n_sensors = 2,
    .adc_bits = 12,
    .rate_max_hz = 1000,
    .vref_mv = 3300,
    .pressure_min_pa = -45000,
    .pressure_max_pa = 55000,
    .ramp_max_pa_per_s = 40000,
    .gain_permille_per_kpa = 200,
    .board_id = "SIMULATED-M3",
};

/* ---- the simulated actuator -------------------------------------------------------------------------------------- */

#define FLOW_PA_PER_S 40000 /* of the pumps at full drive */
#define FLOW_LAG_MS 50
#define VENT_MS 250
#define REACH_PA 90000
#define KEPT 0x424F4154u /* RAM was kept: this is no power cycle */

typedef struct {
    uint32_t kept;
    uint32_t reset_by;         /* a boat_boot_reason, for the next boot */
    uint32_t ms;               /* since power-on */
    uint32_t opened_ms;        /* when the valve was opened last */
    uint32_t heard_ms;         /* when the last byte arrived */
    uint32_t overruns;         /* received bytes without space */
    uint32_t estop, sensor_broken;
    uint32_t conversion_ms;    /* a light converter that keeps the main loop waiting */
    int32_t pressure_mpa;      /* thousandths of a Pa */
    int32_t flow_pa_per_s;     /* lags behind the pumps' drive */
    int32_t permille;
    uint32_t vent;
} simulated_actuator;

__attribute__((section(".noinit"))) volatile simulated_actuator actuator;

static void power_on_actuator(void)
{
    volatile uint8_t *at = (volatile uint8_t *)&actuator;
    size_t i;

    for (i = 0; i < sizeof actuator; i++) {
        at[i] = 0;
    }
    actuator.kept = KEPT;
    actuator.vent = 1;
}

/* Let a millisecond pass. */
static void move_actuator(void)
{
    int32_t drive_pa_per_s = FLOW_PA_PER_S / 1000 * actuator.permille;
    int32_t flow = actuator.flow_pa_per_s + (drive_pa_per_s - actuator.flow_pa_per_s) / FLOW_LAG_MS;
    int32_t pressure = actuator.pressure_mpa;

    if (actuator.vent) {
        flow = 0;
        pressure -= pressure / VENT_MS;
    }
    pressure += flow; /* Pa/s for a millisecond is thousandths of a Pa */
    pressure = pressure > 1000 * REACH_PA ? 1000 * REACH_PA : pressure;
    actuator.pressure_mpa = pressure < -1000 * REACH_PA ? -1000 * REACH_PA : pressure;
    actuator.flow_pa_per_s = flow;
    actuator.ms++;
}

static bool read_pressure(int32_t *pressure_pa)
{
    *pressure_pa = actuator.pressure_mpa / 1000;
    return actuator.sensor_broken == 0u;
}

/* Straight sensors: 3.2 and 2.3 counts/kPa on 1600, ambient light that alternates, a little noise. */
static void read_light(uint16_t *counts)
{
    static const int32_t counts_per_mpa[BOAT_SENSORS_MAX] = {32, 23, -30, -21}; /* MPa / 10 */
    static uint32_t noise = 1;
    uint16_t dark = actuator.ms / 10u % 2u != 0u ? 60 : 40;
    uint32_t started_ms = actuator.ms;
    uint8_t i;

    while (actuator.ms - started_ms < actuator.conversion_ms) {
    }
    for (i = 0; i < config.n_sensors; i++) {
        noise = noise * 1664525u + 1013904223u;
        counts[2u * i + 1u] = (uint16_t)(dark + (noise >> 30));
        counts[2u * i] =
            (uint16_t)(dark + 1600 + counts_per_mpa[i] * (actuator.pressure_mpa / 10000) / 1000 + (int32_t)(noise >> 30));
    }
}

static bool estop_pressed(void)
{
    return actuator.estop != 0u;
}

static void drive(int32_t permille, bool vent)
{
    if (vent && actuator.vent == 0u) {
        actuator.opened_ms = actuator.ms;
    }
    actuator.permille = permille;
    actuator.vent = vent ? 1u : 0u;
}

/* ---- clock ------------------------------------------------------------------------------------------------------- */

static volatile uint32_t clock_ms;

void systick_handler(void);
void systick_handler(void)
{
    clock_ms++;
    move_actuator();
}

/* The milliseconds counted, and what SysTick has counted down of the next. */
static uint32_t clock_us(void)
{
    uint32_t ms, ticks;

    do {
        ms = clock_ms;
        ticks = SYSTICK_VALUE;
    } while (ms != clock_ms);
    return 1000u * ms + (TICKS_PER_MS - 1u - ticks) / TICKS_PER_US;
}

/* ---- UART -------------------------------------------------------------------------------------------------------- */

#define TRANSMIT_BYTES 2048u
#define RECEIVE_BYTES 64u /* four commands of the longest; a host sends one at a time */

static uint8_t transmit_ring[TRANSMIT_BYTES], receive_ring[RECEIVE_BYTES];
static size_t transmit_first, transmit_used;
static volatile uint32_t received, taken; /* bytes */

static size_t transmit_room(void)
{
    return TRANSMIT_BYTES - transmit_used;
}

static void transmit(const uint8_t *data, size_t n)
{
    while (n--) {
        transmit_ring[(transmit_first + transmit_used++) % TRANSMIT_BYTES] = *data++;
    }
}

static void feed_uart(void)
{
    while (transmit_used != 0u && (UART_STATE & UART_TRANSMIT_FULL) == 0u) {
        UART_DATA = transmit_ring[transmit_first];
        transmit_first = (transmit_first + 1u) % TRANSMIT_BYTES;
        transmit_used--;
    }
}

void uart_receive_handler(void);
void uart_receive_handler(void)
{
    uint8_t byte;

    UART_INTERRUPT_CLEAR = UART_RECEIVE_INTERRUPT; /* before the byte is taken: the next one may follow at once */
    byte = (uint8_t)UART_DATA;
    actuator.heard_ms = actuator.ms;
    if (received - taken < RECEIVE_BYTES) {
        receive_ring[received % RECEIVE_BYTES] = byte;
        received++;
    } else {
        actuator.overruns++;
    }
}

static size_t take_received(uint8_t *data)
{
    size_t n = 0;

    while (taken != received) {
        data[n++] = receive_ring[taken % RECEIVE_BYTES];
        taken++;
    }
    return n;
}

/* ---- watchdog, boot and main loop -------------------------------------------------------------------------------- */

void nmi_handler(void);
/* The main loop has not run for a period: open the valve. After another period the watchdog resets the processor. */
void nmi_handler(void)
{
    drive(0, true);
    actuator.reset_by = BOAT_WATCHDOG;
}

static boat_boot_reason boot_reason(void)
{
    boat_boot_reason reason = (boat_boot_reason)actuator.reset_by;

    if (actuator.kept != KEPT) {
        power_on_actuator();
        reason = BOAT_POWER;
    }
    return reason;
}

static void start_peripherals(void)
{
    SYSTICK_RELOAD = TICKS_PER_MS - 1u;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = SYSTICK_ENABLE_ALL;
    UART_DIVIDER = CLOCK_HZ / UART_BAUD;
    UART_CONTROL = UART_ENABLE_ALL;
    INTERRUPTS_ENABLE = 1u;
    WATCHDOG_LOAD = WATCHDOG_PERIOD_MS * TICKS_PER_MS;
    WATCHDOG_CONTROL = WATCHDOG_ENABLE_ALL;
}

int main(void)
{
    static const boat_hardware hardware = {
        clock_us, read_pressure, read_light, estop_pressed, drive, transmit_room, transmit,
    };
    static boat board;
    static uint8_t data[RECEIVE_BYTES];
    boat_boot_reason reason = boot_reason();
    size_t n;

    drive(0, true);
    start_peripherals();
    boat_init(&board, &config, &hardware, reason);
    for (;;) {
        WATCHDOG_CLEAR = 1u;
        actuator.reset_by = BOAT_RESET_PIN; /* unless the watchdog finds otherwise */
        n = take_received(data);
        if (n != 0u) {
            boat_receive(&board, data, n);
        }
        boat_poll(&board);
        feed_uart();
    }
}
