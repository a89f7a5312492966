#include "boat_frame.h"

#define RESIDUE 0x2144DF1Cu /* CRC-32 of anything followed by its own CRC-32 */

/* A table of sixteen: 64 bytes of flash buy a quarter of the bitwise loop's time. */
uint32_t boat_crc32(const uint8_t *data, size_t n)
{
    static const uint32_t nibbles[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    uint32_t crc = 0xFFFFFFFFu;
    size_t i;

    for (i = 0; i < n; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ nibbles[crc & 15u];
        crc = (crc >> 4) ^ nibbles[crc & 15u];
    }
    return ~crc;
}

/* A body is shorter than 254 bytes, so COBS only writes into each 00 the distance to the next one. */
size_t boat_seal(uint8_t *frame, size_t n)
{
    uint32_t crc = boat_crc32(&frame[1], n);
    size_t mark = 0;
    size_t at;

    for (at = n + 1u; at <= (n + 4u); at++) {
        frame[at] = (uint8_t)crc;
        crc >>= 8;
    }
    frame[at] = 0;
    for (at = 1; at <= (n + 5u); at++) {
        if (frame[at] == 0u) {
            frame[mark] = (uint8_t)(at - mark);
            mark = at;
        }
    }
    return n + BOAT_SEAL_ROOM;
}

/* Undo COBS in place: every code becomes the 00 it stands for; the first one belongs to nothing. */
static bool unstuff(uint8_t *data, size_t n)
{
    size_t at = 0;

    while (at < n) {
        uint8_t run = data[at];
        data[at] = 0;
        at += run;
    }
    return (at == n) && (n >= (1u + BOAT_BODY_MIN)) && (n <= (1u + BOAT_BODY_MAX));
}

static size_t end_run(boat_receiver *receiver, const uint8_t **body)
{
    size_t n = receiver->collected;

    receiver->collected = 0;
    if (receiver->skipping) {
        receiver->skipping = false;
        return 0;
    }
    if (n == 0u) { /* an empty frame is legal and means nothing */
        return 0;
    }
    if (!unstuff(receiver->data, n)) {
        receiver->malformed++;
        return 0;
    }
    if (boat_crc32(&receiver->data[1], n - 1u) != RESIDUE) {
        receiver->crc_errors++;
        return 0;
    }
    receiver->frames++;
    *body = &receiver->data[1];
    return n - 5u;
}

size_t boat_take_byte(boat_receiver *receiver, uint8_t byte, const uint8_t **body)
{
    if (byte == 0u) {
        return end_run(receiver, body);
    }
    if (receiver->collected < BOAT_COLLECT_MAX) {
        receiver->data[receiver->collected] = byte;
        receiver->collected++;
    } else {
        receiver->oversize += receiver->skipping ? 0u : 1u;
        receiver->skipping = true;
    }
    return 0;
}
