/* What the tests in C share. */
#ifndef TROCAR_TESTS_CHECK_H
#define TROCAR_TESTS_CHECK_H

#include <stdio.h>

#include <trocar.h>

static int failed;

#define CHECK(condition)                                                        \
    do {                                                                        \
        if (!(condition)) {                                                     \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);     \
            failed = 1;                                                         \
        }                                                                       \
    } while (0)
#define REFUSED(status, call) CHECK((call) == TROCAR_STATUS_##status)

/* A pointer to an odd byte of a place large enough. */
static union {
    double number;
    unsigned char bytes[2 * TROCAR_STATE_SIZE];
} room;
#define ODD(type) ((type *)(void *)(room.bytes + 1))

#endif
