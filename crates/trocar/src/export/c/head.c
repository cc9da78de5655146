/* @TITLE@
 *
@ORIGIN@ *
 * @STEM@.h explains the use; C++ includes it, too. C99, with <math.h> and <stdint.h> and nothing else: no memory but
 * trocar_state, no recursion, bounded work.
//@if single
 * All arithmetic is in float, which must be IEEE 754 binary32.
//@else
 * A double must be IEEE 754 binary64 (AVR's is not).
//@end
 * Compile without -ffast-math or the like, which is refused if the compiler defines a macro for it: without IEEE rules
 * forces are wrong. Fused multiply-add, which moves last digits, is switched off below; give a compiler that is not
 * named there the option that does so (-ffp-contract=off of gcc and clang).
 *
 * Numbers in brackets are equations of EMS, key in SOURCES.md of trocar. Not a medical device. */

#include "@STEM@.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) \
    || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(_M_FP_FAST)
#error "compile this file without -ffast-math, -Ofast or the like: its forces would be wrong"
#endif

/* gcc does not know the pragma of C99 and warns of it. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("fp-contract=off")
#elif defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract (off)
#else
#pragma STDC FP_CONTRACT OFF
#endif

#include <math.h>
//@if integers
#include <stdint.h>
//@end

