/* Vectors of three. */
#ifndef DELTAPH_VECTOR_H
#define DELTAPH_VECTOR_H

static inline double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const double a[3], const double b[3], double c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void subtract(const double a[3], const double b[3], double c[3])
{
    for (int i = 0; i < 3; ++i)
        c[i] = a[i] - b[i];
}

/* a += factor b */
static inline void add_scaled(double a[3], double factor, const double b[3])
{
    for (int i = 0; i < 3; ++i)
        a[i] += factor * b[i];
}

/* The inverse of a matrix A (3, 3), by its columns. */
typedef struct dph_inverse {
    double column[3][3];
    double det; /* of A */
} dph_inverse;

/* Given the rows a_i of A: the columns of its inverse are a_j x a_k / det A. Not finite where A is singular. */
static inline void invert_rows(double a[3][3], dph_inverse *inverse)
{
    cross(a[1], a[2], inverse->column[0]);
    cross(a[2], a[0], inverse->column[1]);
    cross(a[0], a[1], inverse->column[2]);
    inverse->det = dot(a[0], inverse->column[0]);
    double scale = 1.0 / inverse->det;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            inverse->column[i][k] *= scale;
}

#endif
