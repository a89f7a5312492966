#include "host.h"

#include <math.h>
#include <string.h>

#define FLOW_KPA_PER_S 40.0 /* of the pumps at full drive */
#define FLOW_LAG_S 0.05
#define VENT_S 0.25

host_state host;

boat_config host_config = {
    .fw_major = 1,
    .fw_minor = 0,
    .n_sensors = 2,
    .adc_bits = 12,
    .rate_max_hz = 20000,
    .vref_mv = 3300,
    .pressure_min_pa = -45000,
    .pressure_max_pa = 55000,
    .ramp_max_pa_per_s = 40000,
    .gain_permille_per_kpa = 200,
    .board_id = "SIMULATED-FW1",
};

static uint32_t clock_us(void)
{
    return (uint32_t)host.clock_us;
}

static bool read_pressure(int32_t *pressure_pa)
{
    *pressure_pa = host.pressure_pa;
    return host.pressure_valid;
}

/* Straight sensors on an elongation in proportion to pressure, ambient light that alternates, a little noise. */
static void read_light(uint16_t *counts)
{
    static const double slopes_per_kpa[BOAT_SENSORS_MAX] = {3.2, 2.3, -3.0, -2.1};
    static uint32_t noise = 1;
    uint16_t full = (uint16_t)((1u << host_config.adc_bits) - 1u);
    double lit;
    unsigned i;

    for (i = 0; i < host_config.n_sensors; i++) {
        uint16_t dark = (uint16_t)(host.clock_us / 10000u % 2u ? 60 : 40);
        noise = noise * 1664525u + 1013904223u;
        counts[2 * i + 1] = (uint16_t)(dark + (noise >> 30));
        lit = dark + 1600.0 + slopes_per_kpa[i] * host.pressure_pa / 1000.0 + (noise >> 28) % 4;
        counts[2 * i] = (uint16_t)fmax(0.0, fmin(full, lit));
        if (host.saturated >> i & 1) {
            counts[2 * i] = counts[2 * i + 1] = full;
        }
    }
}

static bool estop_pressed(void)
{
    return host.estop;
}

static void drive(int32_t permille, bool vent)
{
    host.permille = permille;
    host.vent = vent;
}

/* `drop_samples` leaves space for any message, but not for a SAMPLE and what must stay free behind it. */
static size_t transmit_room(void)
{
    size_t room = host.room > host.n_out ? host.room - host.n_out : 0;

    return host.drop_samples && room > BOAT_ROOM_FOR_MESSAGES ? BOAT_ROOM_FOR_MESSAGES : room;
}

static void transmit(const uint8_t *data, size_t n)
{
    memcpy(host.out + host.n_out, data, n);
    host.n_out += n;
}

const boat_hardware host_hardware = {
    clock_us, read_pressure, read_light, estop_pressed, drive, transmit_room, transmit,
};

void host_reset(void)
{
    memset(&host, 0, sizeof host);
    host.pressure_valid = true;
    host.room = HOST_TX_MAX;
    host.reach_kpa = 90.0;
}

void host_plant(double seconds)
{
    host.flow += (FLOW_KPA_PER_S * host.permille / 1000.0 - host.flow) * fmin(1.0, seconds / FLOW_LAG_S);
    if (host.vent) {
        host.flow = 0.0;
        host.kpa *= exp(-seconds / VENT_S);
    }
    host.kpa += (host.flow - host.leak_per_s * host.kpa) * seconds;
    host.kpa = fmax(-host.reach_kpa, fmin(host.reach_kpa, host.kpa));
    host.pressure_pa = (int32_t)lrint(1000.0 * host.kpa);
}
