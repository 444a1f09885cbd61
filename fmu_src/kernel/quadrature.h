/* Gauss-Legendre quadrature with 16 and with 6 points: nodes and weights on [-1, 1], Abramowitz and Stegun table 25.4, to double precision. */
#ifndef DELTAPH_QUADRATURE_H
#define DELTAPH_QUADRATURE_H

enum { GAUSS_PAIRS = 8 };

static const double gauss_node[GAUSS_PAIRS] = {
    0.095012509837637440185, 0.28160355077925891323, 0.45801677765722738634, 0.61787624440264374845,
    0.7554044083550030339, 0.86563120238783174388, 0.94457502307323257608, 0.9894009349916499326,
};

static const double gauss_weight[GAUSS_PAIRS] = {
    0.18945061045506849629, 0.18260341504492358887, 0.16915651939500253819, 0.14959598881657673208,
    0.12462897125553387205, 0.09515851168249278481, 0.062253523938647892863, 0.027152459411754094852,
};

/* Integral of f(x, context) from a to b. Relative error near the rounding error where the nearest singularity of f is no closer to
 * either end than half the interval: the Bernstein ellipse is then rho = 2.9, and rho^-32 = 2e-15. */
static inline double gauss_integral(double (*f)(double x, const void *context), const void *context, double a, double b)
{
    double centre = 0.5 * (a + b), half = 0.5 * (b - a), sum = 0.0;
    for (int i = 0; i < GAUSS_PAIRS; ++i) {
        double offset = half * gauss_node[i];
        sum += gauss_weight[i] * (f(centre - offset, context) + f(centre + offset, context));
    }
    return half * sum;
}

static const double gauss_node_6[3] = {0.23861918608319690863, 0.66120938646626451366, 0.93246951420315202781};
static const double gauss_weight_6[3] = {0.46791393457269104739, 0.36076157304813860757, 0.17132449237917034504};

/* The same with 6 points: rho^-12. */
static inline double gauss_integral_6(double (*f)(double x, const void *context), const void *context, double a, double b)
{
    double centre = 0.5 * (a + b), half = 0.5 * (b - a), sum = 0.0;
    for (int i = 0; i < 3; ++i) {
        double offset = half * gauss_node_6[i];
        sum += gauss_weight_6[i] * (f(centre - offset, context) + f(centre + offset, context));
    }
    return half * sum;
}

#endif
