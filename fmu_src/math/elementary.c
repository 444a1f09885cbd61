/* The elementary functions of the source FMUs, under names of their own.
 *
 * Importers that compile sources do not always link libm, and a library without it cannot be loaded by every host. With these functions it
 * needs nothing but libc. Binaries are built with SYSTEM_MATH and use the system's libm.
 *
 * Written for this purpose from the functions' identities and Taylor series; within 4 units in the last place of the true value (pow: within
 * a few of them more; tests hold it against a high-precision reference); errno and floating-point exceptions are nobody's concern. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* ---- Bits ------------------------------------------------------------------------------------------------------------------------- */

static uint64_t m_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static double m_from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static const uint64_t m_sign_bit = (uint64_t)1 << 63;

static double m_fabs(double x)
{
    return m_from_bits(m_bits(x) & ~m_sign_bit);
}

static double m_copysign(double x, double y)
{
    return m_from_bits((m_bits(x) & ~m_sign_bit) | (m_bits(y) & m_sign_bit));
}

static double m_fmin(double x, double y)
{
    return x != x || y < x ? y : x;
}

static double m_fmax(double x, double y)
{
    return x != x || y > x ? y : x;
}

/* 2^n for a normal result. */
static double m_power_of_two(int n)
{
    return m_from_bits((uint64_t)(1023 + n) << 52);
}

/* x 2^n, in steps that do not leave the range before the result does. */
static double m_scale(double x, int n)
{
    while (n > 1000) {
        x *= m_power_of_two(1000);
        n -= 1000;
    }
    while (n < -1000) {
        x *= m_power_of_two(-1000);
        n += 1000;
    }
    return x * m_power_of_two(n);
}

/* x = m 2^n with 1 <= m < 2, for finite x > 0. */
static double m_split(double x, int *n)
{
    int subnormal = x < DBL_MIN;
    uint64_t bits = m_bits(subnormal ? x * m_power_of_two(54) : x);
    *n = (int)(bits >> 52) - 1023 - (subnormal ? 54 : 0);
    return m_from_bits((bits & (((uint64_t)1 << 52) - 1)) | ((uint64_t)1023 << 52));
}

/* ---- Rounding ----------------------------------------------------------------------------------------------------------------------- */

/* From here on every double is a whole number. */
static const double m_whole = 4503599627370496.0; /* 2^52 */

static double m_floor(double x)
{
    if (!(m_fabs(x) < m_whole))
        return x;
    double toward_zero = (double)(int64_t)x;
    return m_copysign(toward_zero > x ? toward_zero - 1.0 : toward_zero, x);
}

static double m_ceil(double x)
{
    return -m_floor(-x);
}

static double m_round(double x)
{
    double size = m_fabs(x), down = m_floor(size);
    return m_copysign(size - down >= 0.5 ? down + 1.0 : down, x);
}

/* ---- Roots -------------------------------------------------------------------------------------------------------------------------- */

/* Newton's method on m in [1, 4); the last correction takes its residual from the exact square (Dekker's splitting). */
static double m_sqrt(double x)
{
    if (!(x > 0.0) || x > DBL_MAX)
        return x < 0.0 ? NAN : x;
    int n;
    double m = m_split(x, &n);
    if (n % 2 != 0) {
        m *= 2.0;
        n -= 1;
    }
    double y = 0.5 + 0.5 * m - 0.0625 * (m - 1.0) * (m - 1.0);
    for (int i = 0; i < 5; ++i)
        y = 0.5 * (y + m / y);
    double high = y * 134217729.0; /* 2^27 + 1 */
    high -= high - y;
    double low = y - high;
    y += (((m - high * high) - 2.0 * high * low) - low * low) / (2.0 * y);
    return m_scale(y, n / 2);
}

static double m_hypot(double x, double y)
{
    double great = m_fmax(m_fabs(x), m_fabs(y)), small = m_fmin(m_fabs(x), m_fabs(y));
    if (great > DBL_MAX || great == 0.0 || x != x || y != y)
        return great > DBL_MAX ? great : great + x * 0.0 + y * 0.0;
    double ratio = small / great;
    return great * m_sqrt(1.0 + ratio * ratio);
}

/* ---- Exponential and logarithm -------------------------------------------------------------------------------------------------------- */

/* ln 2, the first part with 32 bits: its product with an exponent is exact. */
static const double m_ln2_high = 0x1.62e42fee00000p-1, m_ln2_low = 1.908214929270587816e-10;

/* exp(r) - 1 for |r| <= 0.36 by Taylor's series: the term after r^14 is below 2e-19 r. */
static double m_expm1_series(double r)
{
    double sum = 1.0;
    for (int i = 14; i > 1; --i)
        sum = 1.0 + r * sum / i;
    return r * sum;
}

static double m_exp(double x)
{
    if (!(x > -746.0))
        return x != x ? x : 0.0;
    if (x > 710.0)
        return HUGE_VAL;
    double k = m_round(x / (m_ln2_high + m_ln2_low));
    double r = (x - k * m_ln2_high) - k * m_ln2_low;
    return m_scale(1.0 + m_expm1_series(r), (int)k);
}

static double m_expm1(double x)
{
    return m_fabs(x) < 0.36 ? m_expm1_series(x) : m_exp(x) - 1.0;
}

/* (e^2x - 1) / (e^2x + 1), each range in the form that does not cancel. */
static double m_tanh(double x)
{
    double size = m_fabs(x), t;
    if (size < 0.18) {
        t = m_expm1_series(2.0 * size);
        t /= t + 2.0;
    } else if (size < 0.36) {
        t = m_expm1_series(size);
        t /= t + 2.0;
        t = 2.0 * t / (1.0 + t * t);
    } else if (size < 22.0) {
        t = 1.0 - 2.0 / (m_exp(2.0 * size) + 1.0);
    } else {
        t = x != x ? x : 1.0;
    }
    return m_copysign(t, x);
}

/* ln(2^n m) = n ln 2 + 2 artanh((m-1)/(m+1)), m in [sqrt 1/2, sqrt 2]: the term after s^23 is below 3e-20 s. */
static double m_log(double x)
{
    if (!(x > 0.0) || x > DBL_MAX)
        return x == 0.0 ? -HUGE_VAL : x < 0.0 ? NAN : x;
    int n;
    double m = m_split(x, &n);
    if (m > 1.4142135623730950488) {
        m *= 0.5;
        n += 1;
    }
    double f = m - 1.0, s = f / (m + 1.0), s2 = s * s, sum = 0.0;
    for (int i = 23; i > 1; i -= 2)
        sum = s2 * (1.0 / i + sum);
    /* 2 s = f - s f, so that the leading term is exact. */
    return n * m_ln2_high + (f + (n * m_ln2_low + (2.0 * s * sum - s * f)));
}

/* Within |y ln x| units in the last place: enough for the roots of ratios near 1 that it is here for. */
static double m_pow(double x, double y)
{
    if (x == 0.0)
        return y == 0.0 ? 1.0 : y > 0.0 ? 0.0 : HUGE_VAL;
    return y == 0.0 ? 1.0 : m_exp(y * m_log(x));
}

static double m_cbrt(double x)
{
    double size = m_fabs(x);
    if (size == 0.0 || !(size <= DBL_MAX))
        return x;
    int n;
    double m = m_split(size, &n);
    int third = n >= 0 ? n / 3 : -((2 - n) / 3);
    m *= m_power_of_two(n - 3 * third);
    double y = m_exp(m_log(m) / 3.0);
    y -= (y - m / (y * y)) / 3.0;
    return m_copysign(m_scale(y, third), x);
}

/* ---- Angles ------------------------------------------------------------------------------------------------------------------------- */

/* pi/2 in parts of 23 bits: products with a count of quarter turns below 2^30 are exact. */
static const double m_quarter[5] = {0x1.921fb4p+0, 0x1.4442d0p-24, 0x1.846988p-48, 0x1.8cc514p-72, 0x1.80dc1cp-95};

/* Remainder of x after whole quarter turns, as r + tail with |r| <= pi/4; returns the number of quarter turns modulo 4. Beyond 2^30
 * quarter turns an angle has lost its meaning: the remainder is then 0. */
static int m_reduce(double x, double *r, double *tail)
{
    double turns = m_round(x * 0.63661977236758134308);
    *r = *tail = 0.0;
    if (!(m_fabs(turns) < 1073741824.0))
        return 0;
    double sum = x, rest = 0.0;
    for (int i = 0; i < 5; ++i) {
        double part = turns * m_quarter[i], next = sum - part;
        rest += (sum - next) - part;
        sum = next;
    }
    *r = sum + rest;
    *tail = (sum - *r) + rest;
    return (int)((int64_t)turns & 3);
}

/* Taylor's series for |r| <= pi/4: the term after r^19 is below 5e-22 r, that after r^18 below 4e-21. */
static double m_sine(double r, double tail)
{
    double r2 = r * r, sum = 0.0;
    for (int i = 19; i > 1; i -= 2)
        sum = r2 / (double)(i * (i - 1)) * (1.0 - sum);
    return r - (r * sum - tail * (1.0 - 0.5 * r2));
}

static double m_cosine(double r, double tail)
{
    double r2 = r * r, sum = 0.0;
    for (int i = 18; i > 2; i -= 2)
        sum = r2 / (double)(i * (i - 1)) * (1.0 - sum);
    double half = 0.5 * r2, one = 1.0 - half;
    return one + (((1.0 - one) - half) + (half * sum - r * tail));
}

static double m_quadrant(int quarter, double r, double tail)
{
    double value = quarter % 2 == 0 ? m_sine(r, tail) : m_cosine(r, tail);
    return quarter >= 2 ? -value : value;
}

static double m_sin(double x)
{
    double r, tail;
    int quarter = m_reduce(x, &r, &tail);
    return x - x == 0.0 ? m_quadrant(quarter, r, tail) : NAN;
}

static double m_cos(double x)
{
    double r, tail;
    int quarter = m_reduce(x, &r, &tail);
    return x - x == 0.0 ? m_quadrant((quarter + 1) % 4, r, tail) : NAN;
}

/* atan(y / x) for 0 <= y <= x: the table's angle nearest below 1/16 turns the rest to |u| <= 1/16, where the term after u^13 is below
 * 6e-20 u. */
static double m_atan_octant(double y, double x)
{
    static const double angle[9] = {0.0,
                                    0.1243549945467614350314,
                                    0.2449786631268641541721,
                                    0.3587706702705722203959,
                                    0.4636476090008061162143,
                                    0.5585993153435624359715,
                                    0.6435011087932843868028,
                                    0.718829999621624505417,
                                    0.7853981633974483096157};
    int i = (int)(8.0 * (y / x) + 0.5);
    double t = 0.125 * i;
    double u = (y - t * x) / (x + t * y), u2 = u * u, sum = 0.0;
    for (int k = 13; k > 1; k -= 2)
        sum = u2 * (1.0 / k - sum);
    return angle[i] + (u - u * sum);
}

static double m_atan2(double y, double x)
{
    static const double half_turn_low = 1.2246467991473531772e-16; /* pi minus its double */
    static const double half_turn = 3.141592653589793116;
    double a = m_fabs(y), b = m_fabs(x), angle;
    if (x != x || y != y)
        return NAN;
    if (a > DBL_MAX || b > DBL_MAX) { /* as if infinite ones were equally long */
        a = a > DBL_MAX ? 1.0 : 0.0;
        b = b > DBL_MAX ? 1.0 : 0.0;
    }
    int down = (a > b ? a : b) > 1e300 ? -100 : (a > b ? a : b) < 1e-200 ? 600 : 0; /* keep products in range */
    a = m_scale(a, down);
    b = m_scale(b, down);
    int behind = (m_bits(x) & m_sign_bit) != 0;
    if (a > b)
        angle = 0.5 * half_turn + ((behind ? 1.0 : -1.0) * m_atan_octant(b, a) + 0.5 * half_turn_low);
    else
        angle = a == 0.0 ? 0.0 : m_atan_octant(a, b);
    if (behind && !(a > b))
        angle = (half_turn - angle) + half_turn_low;
    return m_copysign(angle, y);
}

/* From here on these are the functions of <math.h>. */
#undef fabs
#define fabs m_fabs
#undef copysign
#define copysign m_copysign
#undef fmin
#define fmin m_fmin
#undef fmax
#define fmax m_fmax
#undef floor
#define floor m_floor
#undef ceil
#define ceil m_ceil
#undef round
#define round m_round
#undef sqrt
#define sqrt m_sqrt
#undef hypot
#define hypot m_hypot
#undef exp
#define exp m_exp
#undef expm1
#define expm1 m_expm1
#undef tanh
#define tanh m_tanh
#undef log
#define log m_log
#undef pow
#define pow m_pow
#undef cbrt
#define cbrt m_cbrt
#undef sin
#define sin m_sin
#undef cos
#define cos m_cos
#undef atan2
#define atan2 m_atan2
