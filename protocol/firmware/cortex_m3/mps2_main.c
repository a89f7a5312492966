/* The lab's own part on an emulated Cortex-M3, the machine mps2-an385 of QEMU: UART, clock and watchdog of the machine,
   and a simulated actuator in place of sensors, pumps and valve.

   The actuator is in RAM that a reset keeps, as a bladder keeps its air: `actuator` is what a debugger reads, and where
   it sets a fault. */
#include "boat.h"

/* ---- the machine's registers ------------------------------------------------------------------------------------- */

#define CLOCK_HZ 25000000u
#define TICKS_PER_MS (CLOCK_HZ / 1000u)
#define TICKS_PER_US (CLOCK_HZ / 1000000u)

typedef struct {
    uint32_t data;
    uint32_t state;
    uint32_t control;
    uint32_t interrupt_clear;
    uint32_t divider;
} uart_registers;

#define UART_TRANSMIT_FULL 1u     /* in `state` */
#define UART_ENABLE_ALL 0xBu      /* in `control`: transmitter, receiver, interrupt of the receiver */
#define UART_RECEIVE_INTERRUPT 2u /* in `interrupt_clear` */
#define UART_BAUD 921600u

typedef struct {
    uint32_t load;
    uint32_t value;
    uint32_t control;
    uint32_t clear;
} watchdog_registers;

#define WATCHDOG_ENABLE_ALL 3u /* in `control`: non-maskable interrupt after one period, reset after two */
#define WATCHDOG_PERIOD_MS 125u

typedef struct {
    uint32_t control;
    uint32_t reload;
    uint32_t value;
} systick_registers;

#define SYSTICK_ENABLE_ALL 7u /* in `control`: counter, interrupt, the processor's own clock */

/* at the addresses that mps2.ld gives them */
extern volatile uart_registers uart;
extern volatile watchdog_registers watchdog;
extern volatile systick_registers systick;
extern volatile uint32_t interrupts_enable;

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
#define REACH_MPA 90000000 /* thousandths of a Pa, in either direction */
#define KEPT 0x424F4154u /* RAM was kept: this is no power cycle */

typedef struct {
    uint32_t kept;
    uint32_t reset_by;         /* a boat_boot_reason, for the next boot */
    uint32_t ms;               /* since power-on */
    uint32_t opened_ms;        /* when the valve was opened last */
    uint32_t heard_ms;         /* when the last byte arrived */
    uint32_t overruns;         /* received bytes without space */
    uint32_t estop;
    uint32_t sensor_broken;
    uint32_t conversion_ms;    /* a light converter that keeps the main loop waiting */
    int32_t pressure_mpa;      /* thousandths of a Pa */
    int32_t flow_pa_per_s;     /* lags behind the pumps' drive */
    int32_t permille;
    uint32_t vent;
} simulated_actuator;

__attribute__((section(".noinit"))) static volatile simulated_actuator actuator;

static void power_on_actuator(void)
{
    static const simulated_actuator at_ambient = {.kept = KEPT, .vent = 1};

    actuator = at_ambient;
}

/* Let a millisecond pass. */
static void move_actuator(void)
{
    int32_t drive_pa_per_s = (FLOW_PA_PER_S / 1000) * actuator.permille;
    int32_t flow_pa_per_s = actuator.flow_pa_per_s;
    int32_t pressure_mpa = actuator.pressure_mpa;

    flow_pa_per_s += (drive_pa_per_s - flow_pa_per_s) / FLOW_LAG_MS;
    if (actuator.vent != 0u) {
        flow_pa_per_s = 0;
        pressure_mpa -= pressure_mpa / VENT_MS;
    }
    pressure_mpa += flow_pa_per_s; /* Pa/s for a millisecond is thousandths of a Pa */
    if (pressure_mpa > REACH_MPA) {
        pressure_mpa = REACH_MPA;
    }
    if (pressure_mpa < -REACH_MPA) {
        pressure_mpa = -REACH_MPA;
    }
    actuator.pressure_mpa = pressure_mpa;
    actuator.flow_pa_per_s = flow_pa_per_s;
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
    static const int32_t tenths_per_kpa[BOAT_SENSORS_MAX] = {32, 23, -30, -21};
    static uint32_t noise = 1;
    uint32_t started_ms = actuator.ms;
    uint32_t dark = 40u + (20u * ((started_ms / 10u) % 2u));
    size_t i;

    /* cppcheck-suppress duplicateExpression ; the interrupt of SysTick counts `ms` meanwhile */
    while ((actuator.ms - started_ms) < actuator.conversion_ms) {
    }
    for (i = 0; i < config.n_sensors; i++) {
        int32_t signal = 1600 + ((tenths_per_kpa[i] * (actuator.pressure_mpa / 10000)) / 1000);

        noise = (noise * 1664525u) + 1013904223u;
        counts[2u * i] = (uint16_t)(dark + (uint32_t)signal + (noise >> 30));
        counts[(2u * i) + 1u] = (uint16_t)(dark + ((noise >> 28) % 4u));
    }
}

static bool estop_pressed(void)
{
    return actuator.estop != 0u;
}

static void drive(int32_t permille, bool vent)
{
    if (vent && (actuator.vent == 0u)) {
        actuator.opened_ms = actuator.ms;
    }
    actuator.permille = permille;
    actuator.vent = vent ? 1UL : 0UL;
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
    uint32_t ms;
    uint32_t ticks;

    do {
        ms = clock_ms;
        ticks = systick.value;
    } while (ms != clock_ms);
    return (1000u * ms) + ((TICKS_PER_MS - 1u - ticks) / TICKS_PER_US);
}

/* ---- UART -------------------------------------------------------------------------------------------------------- */

#define TRANSMIT_BYTES 2048u
#define RECEIVE_BYTES 64u /* three of the longest command; a host sends one at a time */

static uint8_t transmit_ring[TRANSMIT_BYTES];
static size_t transmit_first;
static size_t transmit_used;
static uint8_t receive_ring[RECEIVE_BYTES];
static volatile uint32_t received; /* bytes, by the interrupt */
static volatile uint32_t taken;    /* bytes, by the main loop */

static size_t transmit_room(void)
{
    return TRANSMIT_BYTES - transmit_used;
}

static void transmit(const uint8_t *data, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++) {
        transmit_ring[(transmit_first + transmit_used) % TRANSMIT_BYTES] = data[i];
        transmit_used++;
    }
}

static void feed_uart(void)
{
    while ((transmit_used != 0u) && ((uart.state & UART_TRANSMIT_FULL) == 0u)) {
        uart.data = transmit_ring[transmit_first];
        transmit_first = (transmit_first + 1u) % TRANSMIT_BYTES;
        transmit_used--;
    }
}

void uart_receive_handler(void);
void uart_receive_handler(void)
{
    uint8_t byte;

    uart.interrupt_clear = UART_RECEIVE_INTERRUPT; /* before the byte is taken: the next one may follow at once */
    byte = (uint8_t)uart.data;
    actuator.heard_ms = actuator.ms;
    if ((received - taken) < RECEIVE_BYTES) {
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
        data[n] = receive_ring[taken % RECEIVE_BYTES];
        n++;
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
    actuator.reset_by = (uint32_t)BOAT_WATCHDOG;
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
    systick.reload = TICKS_PER_MS - 1u;
    systick.value = 0u;
    systick.control = SYSTICK_ENABLE_ALL;
    uart.divider = CLOCK_HZ / UART_BAUD;
    uart.control = UART_ENABLE_ALL;
    interrupts_enable = 1u;
    watchdog.load = WATCHDOG_PERIOD_MS * TICKS_PER_MS;
    watchdog.control = WATCHDOG_ENABLE_ALL;
}

int main(void)
{
    static const boat_hardware hardware = {
        clock_us, read_pressure, read_light, estop_pressed, drive, transmit_room, transmit,
    };
    static boat board;
    static uint8_t data[RECEIVE_BYTES];
    boat_boot_reason reason = boot_reason();

    drive(0, true);
    start_peripherals();
    boat_init(&board, &config, &hardware, reason);
    for (;;) {
        size_t n = take_received(data);

        watchdog.clear = 1u;
        actuator.reset_by = (uint32_t)BOAT_RESET_PIN; /* unless the watchdog finds otherwise */
        if (n != 0u) {
            boat_receive(&board, data, n);
        }
        boat_poll(&board);
        feed_uart();
    }
}
