/* What the compiler of C makes of the header, for comparison with Rust. */
#include <stddef.h>
#include <stdio.h>

#include <trocar.h>

_Static_assert(sizeof(trocar_state) == TROCAR_STATE_SIZE, "size of a state");
_Static_assert(_Alignof(trocar_state) == _Alignof(double), "alignment of a state");

int main(void)
{
    printf("%lu %lu %lu %lu %lu %lu %lu %lu %lu %lu %lu %lu %lu %lu %lu\n", (unsigned long)sizeof(trocar_state),
           (unsigned long)sizeof(trocar_status), (unsigned long)sizeof(trocar_tunable),
           (unsigned long)offsetof(trocar_tunable, description), (unsigned long)offsetof(trocar_tunable, value),
           (unsigned long)offsetof(trocar_tunable, least), (unsigned long)offsetof(trocar_tunable, above_least),
           (unsigned long)offsetof(trocar_tunable, element), (unsigned long)sizeof(trocar_compensator_options),
           (unsigned long)offsetof(trocar_compensator_options, adaptation),
           (unsigned long)offsetof(trocar_compensator_options, flip_force), (unsigned long)sizeof(trocar_estimate),
           (unsigned long)offsetof(trocar_estimate, adapting), (unsigned long)offsetof(trocar_estimate, fault),
           (unsigned long)sizeof(trocar_drift));
    return 0;
}
