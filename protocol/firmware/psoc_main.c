/* The lab's own part on a PSoC 5LP: components of the schematic behind the seven functions of `boat_hardware`.

   Names of components (README.md says what each is): USBUART, ADC, Sensor_Mux, Emitters, Pressure_ADC, Pump_Up,
   Pump_Down, Valve, EStop, Clock_us. Only this file knows them. */
#include <project.h>

#include "boat.h"

#define TRANSMIT_BYTES 2048u
#define PACKET_BYTES 64u
#define SETTLE_US 40u             /* emitter and photodiode, after switching */
#define PUMP_FULL 1000            /* the PWMs' period */
#define PRESSURE_ZERO_COUNTS 2048 /* at ambient */
#define PA_PER_COUNT 49           /* of the pressure sensor's span */
#define PRESSURE_BROKEN_COUNTS 20 /* this near either end of the range the wire is broken */

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
};

/* ---- sending: a ring, emptied packet by packet ------------------------------------------------------------------- */

static uint8_t ring[TRANSMIT_BYTES];
static size_t ring_first;
static size_t ring_used;

static bool host_listens(void)
{
    return (USBUART_GetConfiguration() != 0u) && ((USBUART_GetLineControl() & USBUART_LINE_CONTROL_DTR) != 0u);
}

static size_t transmit_room(void)
{
    if (!host_listens()) {
        return 0;
    }
    return TRANSMIT_BYTES - ring_used;
}

static void transmit(const uint8_t *data, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++) {
        ring[(ring_first + ring_used) % TRANSMIT_BYTES] = data[i];
        ring_used++;
    }
}

/* Hand the next packet to the USB component. A computer holds back what ends with a full packet until a shorter one
   comes, so a full packet with nothing behind it is followed by an empty one. */
static void feed_usb(void)
{
    static uint8_t packet[PACKET_BYTES];
    static bool owes_empty_packet;
    uint16_t n = 0;

    if (!host_listens()) {
        ring_used = 0; /* what the last host did not read is not for the next one */
        owes_empty_packet = false;
        return;
    }
    if ((USBUART_CDCIsReady() == 0u) || ((ring_used == 0u) && !owes_empty_packet)) {
        return;
    }
    while ((n < PACKET_BYTES) && (ring_used != 0u)) {
        packet[n] = ring[ring_first];
        ring_first = (ring_first + 1u) % TRANSMIT_BYTES;
        n++;
        ring_used--;
    }
    USBUART_PutData(packet, n);
    owes_empty_packet = (n == PACKET_BYTES);
}

/* ---- the other six ----------------------------------------------------------------------------------------------- */

/* A 32-bit down counter at 1 MHz. */
static uint32_t clock_us(void)
{
    return ~Clock_us_ReadCounter();
}

static bool read_pressure(int32_t *pressure_pa)
{
    static int32_t counts = PRESSURE_ZERO_COUNTS;

    if (Pressure_ADC_IsEndConversion(Pressure_ADC_RETURN_STATUS) != 0u) {
        counts = Pressure_ADC_GetResult16();
    }
    *pressure_pa = (counts - PRESSURE_ZERO_COUNTS) * PA_PER_COUNT;
    return (counts > PRESSURE_BROKEN_COUNTS) && (counts < (4096 - PRESSURE_BROKEN_COUNTS));
}

static uint16_t convert(uint8_t sensor)
{
    int16_t counts;

    Sensor_Mux_FastSelect(sensor);
    ADC_StartConvert();
    (void)ADC_IsEndConversion(ADC_WAIT_FOR_RESULT);
    ADC_StopConvert();
    counts = ADC_GetResult16();
    return (counts < 0) ? 0u : (uint16_t)counts;
}

static void read_light(uint16_t *counts)
{
    uint8_t lit;
    uint8_t sensor;

    for (lit = 0; lit < 2u; lit++) {
        Emitters_Write(lit);
        CyDelayUs(SETTLE_US);
        for (sensor = 0; sensor < config.n_sensors; sensor++) {
            counts[(2u * sensor) + (1u - lit)] = convert(sensor);
        }
    }
    Emitters_Write(0u);
}

/* A level that has stood for 20 ms is believed when released, at once when pressed. */
static bool estop_pressed(void)
{
    static uint32_t seen_us;
    static bool pressed;

    if (EStop_Read() == 0u) { /* normally closed to ground is 1 when open: a broken wire is a pressed button */
        if (pressed && ((clock_us() - seen_us) > 20000u)) {
            pressed = false;
        }
    } else {
        pressed = true;
        seen_us = clock_us();
    }
    return pressed;
}

static void drive(int32_t permille, bool vent)
{
    Pump_Up_WriteCompare((uint16_t)((permille > 0) ? ((permille * PUMP_FULL) / 1000) : 0));
    Pump_Down_WriteCompare((uint16_t)((permille < 0) ? ((-permille * PUMP_FULL) / 1000) : 0));
    Valve_Write(vent ? 0u : 1u); /* normally open: without power the pressure goes */
}

/* ---- boot and main loop ------------------------------------------------------------------------------------------ */

static boat_boot_reason boot_reason(void)
{
    if ((CyResetStatus & CY_RESET_WD) != 0u) {
        return BOAT_WATCHDOG;
    }
    if ((CyResetStatus & (CY_RESET_LVID | CY_RESET_LVIA | CY_RESET_HVIA)) != 0u) {
        return BOAT_BROWN_OUT;
    }
    return ((CyResetStatus & CY_RESET_SW) != 0u) ? BOAT_SOFTWARE : BOAT_POWER;
}

/* The chip's own 64 bits as sixteen hexadecimal digits. */
static void read_identity(void)
{
    static const char digits[] = "0123456789ABCDEF";
    uint32 id[2];
    uint8_t i;

    CyGetUniqueId(id);
    for (i = 0; i < 16u; i++) {
        config.board_id[i] = (uint8_t)digits[(id[i / 8u] >> (28u - (4u * (i % 8u)))) & 15u];
    }
}

int main(void)
{
    static const boat_hardware hardware = {
        clock_us, read_pressure, read_light, estop_pressed, drive, transmit_room, transmit,
    };
    static boat board;
    static uint8_t received[PACKET_BYTES];

    drive(0, true);
    CyGlobalIntEnable;
    Clock_us_Start();
    Pump_Up_Start();
    Pump_Down_Start();
    Sensor_Mux_Start();
    ADC_Start();
    Pressure_ADC_Start();
    Pressure_ADC_StartConvert();
    read_identity();
    USBUART_Start(0u, USBUART_5V_OPERATION);
    boat_init(&board, &config, &hardware, boot_reason());
    CyWdtStart(CYWDT_128_TICKS, CYWDT_LPMODE_NOCHANGE); /* a main loop that stands still for 256 ms is a reset */
    for (;;) {
        CyWdtClear();
        if ((USBUART_IsConfigurationChanged() != 0u) && (USBUART_GetConfiguration() != 0u)) {
            USBUART_CDC_Init();
        }
        if ((USBUART_GetConfiguration() != 0u) && (USBUART_DataIsReady() != 0u)) {
            boat_receive(&board, received, USBUART_GetAll(received));
        }
        boat_poll(&board);
        feed_usb();
    }
}
