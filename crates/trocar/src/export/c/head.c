/* @TITLE@
 *
@ORIGIN@ *
 * Units: m, s, N. Position and displacement are positive on insertion; the force is that of the instrument on the seal,
 * the instrument feels its negative.
 *
 *     trocar_state state;
 *     trocar_rest(&state, position);                       once: a seal without force at that position
 *     force = trocar_step(&state, displacement, duration); every sample, from an encoder
 *     force = trocar_step_to(&state, position, duration);  or by the position itself
 *
 * Other files see the declarations alone with
 *     #define trocar_DECLARATIONS_ONLY
 *     #include "this file"
 *
 * C99, with <math.h> and nothing else: no memory but trocar_state, no recursion, bounded work. A double must be IEEE 754
 * binary64 (AVR's is not). Compile with -ffp-contract=off and without -ffast-math or the like, which is refused where
 * the compiler tells: fused arithmetic moves last digits, and without IEEE rules forces are wrong.
 *
 * Numbers in brackets are equations of EMS, key in SOURCES.md of trocar. Not a medical device. */

