/* Any bytes into the receiver, beside a second one written from COBS's definition: the same frames and counts, and
   what is sent again comes out the same. */
#include <string.h>

#include "boat_frame.h"
#include "fuzz.h"

enum verdict { EMPTY, GOOD, CRC, MALFORMED, OVERSIZE };

static uint32_t plain_crc32(const uint8_t *data, size_t n)
{
    uint32_t crc = 0xFFFFFFFFu;

    while (n--) {
        crc ^= *data++;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    return ~crc;
}

/* Decode one run into another buffer; `*length` is that of the body. */
static enum verdict plain_decode(const uint8_t *run, size_t n, uint8_t *body, size_t *length)
{
    size_t in = 0, out = 0;

    if (n == 0) {
        return EMPTY;
    }
    if (n > BOAT_COLLECT_MAX) {
        return OVERSIZE;
    }
    while (in < n) {
        uint8_t code = run[in++];
        if (in + code - 1u > n) {
            return MALFORMED;
        }
        for (; code > 1; code--) {
            body[out++] = run[in++];
        }
        if (in < n) {
            body[out++] = 0;
        }
    }
    if (out < BOAT_BODY_MIN || out > BOAT_BODY_MAX) {
        return MALFORMED;
    }
    *length = out - 4;
    for (size_t i = 0; i < 4; i++) {
        if (body[*length + i] != (uint8_t)(plain_crc32(body, *length) >> (8 * i))) {
            return CRC;
        }
    }
    return GOOD;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    boat_receiver receiver = {0};
    uint32_t counts[5] = {0};
    uint8_t expected[BOAT_COLLECT_MAX], again[BOAT_BODY_MAX + BOAT_SEAL_ROOM];
    const uint8_t *body = NULL;
    size_t begin = 0, length = 0;

    for (size_t i = 0; i < size; i++) {
        size_t found = boat_take_byte(&receiver, data[i], &body);
        if (data[i]) {
            CHECK(found == 0);
            continue;
        }
        enum verdict verdict = plain_decode(data + begin, i - begin, expected, &length);
        counts[verdict]++;
        CHECK((found != 0) == (verdict == GOOD));
        if (found) {
            CHECK(found == length && memcmp(body, expected, length) == 0);
            memcpy(again + 1, body, length);
            CHECK(boat_seal(again, length) == i - begin + 1 && memcmp(again, data + begin, i - begin + 1) == 0);
        }
        begin = i + 1;
    }
    counts[OVERSIZE] += size - begin > BOAT_COLLECT_MAX;
    CHECK(receiver.frames == counts[GOOD] && receiver.crc_errors == counts[CRC]);
    CHECK(receiver.malformed == counts[MALFORMED] && receiver.oversize == counts[OVERSIZE]);
    return 0;
}
