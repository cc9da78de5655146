/* The largest finite number. */
//@if single
static const double trocar_greatest = 0x1.fffffep+127;
//@else
static const double trocar_greatest = 0x1.fffffffffffffp+1023;
//@end

//@if direction
/* -1, 0 or 1. */
static double trocar_sign(double value)
{
    return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

//@end
//@if within
/* value, at most limit in amount. */
static double trocar_within(double value, double limit)
{
    const double below = value < limit ? value : limit;
    return below > -limit ? below : -limit;
}

//@end
//@if holds
/* A force that a model can hold at rest. */
static double trocar_held(double force, double limit)
{
    if (!(fabs(force) <= trocar_greatest)) {
        return 0.0;
    }
    return force < -limit ? -limit : force > limit ? limit : force;
}

//@end
//@if least
/* The smaller one; the other one where one is not a number. */
static double trocar_least(double a, double b)
{
    return b < a || a != a ? b : a;
}

//@end
//@if most
/* The greater one; the other one where one is not a number. */
static double trocar_most(double a, double b)
{
    return b > a || a != a ? b : a;
}

//@end
//@if bits
//@if single
/* A float as its bits: of 32 bits, or the next line does not compile. */
typedef char trocar_needs_float_of_32_bits[sizeof(double) == 4 ? 1 : -1];
typedef union {
    double number;
    uint32_t bits;
} trocar_number;
//@else
/* A double as its bits: of 64 bits, or the next line does not compile. */
typedef char trocar_needs_double_of_64_bits[sizeof(double) == 8 ? 1 : -1];
typedef union {
    double number;
    uint64_t bits;
} trocar_number;
//@end

//@end
//@if decay
//@if single
/* exp(-x) for x >= 0, to two units in the last place; 0 above 87 and where x is not a number. */
static double trocar_decay(double x)
{
    trocar_number shifted, power_of_two;
    double n, r, r2, series;
    if (!(x <= 87.0)) {
        return 0.0;
    }
    /* 1.5*2^23: adding and subtracting it rounds to the nearest integer. */
    shifted.number = -x * 0x1.715476p+0 + 12582912.0;
    n = shifted.number - 12582912.0;
    r = (-x - n * 0x1.62e4p-1) - n * 0x1.7f7d1cp-20; /* ln 2 in two parts */
    r2 = r * r;
    series = ((1.0 + r) + (1.0 / 2.0 + 1.0 / 6.0 * r) * r2)
           + ((1.0 / 24.0 + 1.0 / 120.0 * r) + (1.0 / 720.0 + 1.0 / 5040.0 * r) * r2) * (r2 * r2);
    /* The low bits of the shifted number hold n as an integer; 2^n is built from them. */
    power_of_two.bits = (shifted.bits + 127u) << 23;
    return series * power_of_two.number;
}
//@else
/* exp(-x) for x >= 0, to two units in the last place; 0 above 700 and where x is not a number. */
static double trocar_decay(double x)
{
    trocar_number shifted, power_of_two;
    double n, r, r2, r4, low, mid, high, series;
    if (!(x <= 700.0)) {
        return 0.0;
    }
    /* 1.5*2^52: adding and subtracting it rounds to the nearest integer. */
    shifted.number = -x * 0x1.71547652b82fep+0 + 6755399441055744.0;
    n = shifted.number - 6755399441055744.0;
    r = (-x - n * 0x1.62e42feep-1) - n * 0x1.a39ef35793c76p-33; /* ln 2 in two parts */
    r2 = r * r;
    r4 = r * r * (r * r);
    low = (1.0 + 1.0 * r) + (1.0 / 2.0 + 1.0 / 6.0 * r) * r2;
    mid = (1.0 / 24.0 + 1.0 / 120.0 * r) + (1.0 / 720.0 + 1.0 / 5040.0 * r) * r2;
    high = ((1.0 / 40320.0 + 1.0 / 362880.0 * r) + (1.0 / 3628800.0 + 1.0 / 39916800.0 * r) * r2)
         + (1.0 / 479001600.0 + 1.0 / 6227020800.0 * r) * r4;
    series = low + (mid + high * r4) * r4;
    /* The low bits of the shifted number hold n as an integer; 2^n is built from them. */
    power_of_two.bits = (shifted.bits + 1023u) << 52;
    return series * power_of_two.number;
}
//@end

//@end
//@if logarithm
/* 2*atanh(s) for |s| <= 0.1716. */
static double trocar_twice_atanh(double s)
{
//@if single
    const double q = s * s, q2 = q * q;
    return 2.0 * s * (((1.0 + 1.0 / 3.0 * q) + (1.0 / 5.0 + 1.0 / 7.0 * q) * q2) + 1.0 / 9.0 * (q2 * q2));
//@else
    const double q = s * s, q2 = q * q, q4 = q * q * (q * q);
    const double low = (1.0 + 1.0 / 3.0 * q) + (1.0 / 5.0 + 1.0 / 7.0 * q) * q2;
    const double mid = (1.0 / 9.0 + 1.0 / 11.0 * q) + (1.0 / 13.0 + 1.0 / 15.0 * q) * q2;
    const double high = (1.0 / 17.0 + 1.0 / 19.0 * q) + (1.0 / 21.0 + 1.0 / 23.0 * q) * q2;
    return 2.0 * s * (low + (mid + high * q4) * q4);
//@end
}

/* ln x for normal x > 0. */
static double trocar_logarithm(double x)
{
    trocar_number number;
    double n, m;
//@if single
    uint32_t exponent;
    number.number = x;
    /* Less the bits of the square root of 1/2: what lies above counts to the next power of two; 128 is a bias. */
    exponent = (number.bits - 0x3f3504f3u + ((uint32_t)128 << 23)) >> 23;
    number.bits -= (exponent - 128u) << 23;
    n = (double)(int)exponent - 128.0;
    m = number.number;
    return (n * 0x1.7f7d1cp-20 + trocar_twice_atanh((m - 1.0) / (m + 1.0))) + n * 0x1.62e4p-1;
//@else
    uint64_t exponent;
    number.number = x;
    /* Less the bits of the square root of 1/2: what lies above counts to the next power of two; 1024 is a bias. */
    exponent = (number.bits - 0x3fe6a09e667f3bcdu + ((uint64_t)1024 << 52)) >> 52;
    number.bits -= (exponent - 1024u) << 52;
    n = (double)(int)exponent - 1024.0;
    m = number.number;
    return (n * 0x1.a39ef35793c76p-33 + trocar_twice_atanh((m - 1.0) / (m + 1.0))) + n * 0x1.62e42feep-1;
//@end
}

//@end
//@if one_plus
/* ln(1 + x) for normal 1 + x > 0. */
static double trocar_logarithm_of_one_plus(double x)
{
    return fabs(x) < 0.25 ? trocar_twice_atanh(x / (2.0 + x)) : trocar_logarithm(1.0 + x);
}

//@end
//@if power
/* x^p for x >= 0; 0 and infinite where trocar_decay is 0. */
static double trocar_power(double x, double p)
{
    double exponent;
//@if single
    if (x < 0x1p-126) {
//@else
    if (x < 0x1p-1022) {
//@end
        return p < 0.0 ? HUGE_VAL : 0.0;
    }
    if (x > trocar_greatest) {
        return p < 0.0 ? 0.0 : x;
    }
    exponent = p * trocar_logarithm(x);
    return exponent < 0.0 ? trocar_decay(-exponent) : 1.0 / trocar_decay(exponent);
}

//@end
//@if chord
/* Travel of the instrument for far of a state while its rate goes from start to end in a straight line. */
static double trocar_chord_travel(double far, double start, double end)
{
    const double fall = (start - end) / start;
    return fall > 0.0 ? far / start * (-trocar_logarithm_of_one_plus(-fall) / fall) : far / start;
}

/* (1 - exp(-x))/x for x >= 0. */
static double trocar_filled(double x)
{
//@if single
    const double small = 0.1;
//@else
    const double small = 1e-3;
//@end
    return x < small ? 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0)))
                     : (1.0 - trocar_decay(x)) / x;
}

//@end
