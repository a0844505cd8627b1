/* products: of long columns, their rows scaled, without a copy of them. Included by kalman.c, which has EXPORT. */
#ifndef PRODUCTS_H
#define PRODUCTS_H

#define ROUNDING 1e-12 /* of a column's largest rows: less is none of it */

enum { CHUNK = 512, LANES = 8 }; /* rows that stay in the nearest cache; sums that do not wait for each other */

/* A column of many rows, of which every `stride`-th number is. */
typedef struct {
    const double *first;
    int64_t stride;
} Column;

/* Set `to` to m rows of a column from row j, times their factors; or to what they are more than another's, which a
   factor of 0 leaves out, whatever the number is. */
static void scaled_rows(Column column, const double *before, const double *factors, int64_t j, size_t m,
                        double *restrict to)
{
    const double *restrict from = column.first + j * column.stride, *restrict f = factors + j;
    const size_t stride = (size_t)column.stride;
    if (before) {
        const double *restrict less = before + j;
        for (size_t l = 0; l < m; l++) to[l] = f[l] == 0 ? 0 : (from[l * stride] - less[l]) * f[l];
    } else if (stride == 1) {
        for (size_t l = 0; l < m; l++) to[l] = from[l] * f[l];
    } else {
        for (size_t l = 0; l < m; l++) to[l] = from[l * stride] * f[l];
    }
}

static double product(const double *restrict a, const double *restrict b, size_t m)
{
    double sums[LANES] = {0};
    size_t l = 0;
    for (; l + LANES <= m; l += LANES)
        for (size_t k = 0; k < LANES; k++) sums[k] += a[l + k] * b[l + k];
    for (; l < m; l++) sums[0] += a[l] * b[l];
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

/* Set `to`, (n), to a column, or its change, each row times its factor. */
EXPORT void scaled_column(int64_t n, const double *factors, const double *column, int64_t stride, const double *before,
                          double *to)
{
    scaled_rows((Column){column, stride}, before, factors, 0, (size_t)n, to);
}

/* Set found, (c, c), to the products of columns of n rows, each row times its factor. The room holds c CHUNK numbers. */
EXPORT void scaled_gram(int64_t n, const double *factors, int64_t c, const double *const *columns,
                        const int64_t *strides, double *room, double *found)
{
    memset(found, 0, (size_t)(c * c) * sizeof *found);
    for (int64_t j = 0; j < n; j += CHUNK) {
        const size_t m = (size_t)(n - j < CHUNK ? n - j : CHUNK);
        if (product(factors + j, factors + j, m) == 0) continue;
        for (int64_t k = 0; k < c; k++) {
            double *own = room + k * CHUNK;
            scaled_rows((Column){columns[k], strides[k]}, NULL, factors, j, m, own);
            for (int64_t l = 0; l <= k; l++) found[k * c + l] += product(own, room + l * CHUNK, m);
        }
    }
    for (int64_t k = 0; k < c; k++)
        for (int64_t l = 0; l < k; l++) found[l * c + k] = found[k * c + l];
}

/* Of one column, less another if that is not NULL, of n rows, each row times its factor: set found, (c + 2), to the
   products with c columns, times the same factors, with `left`, (n), as it is, and with itself. Where it has settled, but
   for rounding, nothing else is read. */
EXPORT void scaled_products(int64_t n, const double *factors, const double *column, int64_t stride,
                            const double *before, const double *left, int64_t c, const double *const *columns,
                            const int64_t *strides, double *found)
{
    double own[CHUNK], twice[CHUNK], room[CHUNK], most = 0;
    memset(found, 0, (size_t)(c + 2) * sizeof *found);
    for (int64_t j = 0; j < n; j += CHUNK) {
        const size_t m = (size_t)(n - j < CHUNK ? n - j : CHUNK);
        scaled_rows((Column){column, stride}, before, factors, j, m, own);
        const double power = product(own, own, m);
        most = fmax(most, power);
        found[c + 1] += power;
        if (power <= ROUNDING * ROUNDING * most) continue;
        for (size_t l = 0; l < m; l++) twice[l] = own[l] * factors[j + (int64_t)l];
        for (int64_t k = 0; k < c; k++) {
            const double *other = columns[k] + j;
            if (strides[k] != 1) {
                other = room;
                for (size_t l = 0; l < m; l++) room[l] = columns[k][(j + (int64_t)l) * strides[k]];
            }
            found[k] += product(twice, other, m);
        }
        found[c] += product(own, left + j, m);
    }
}

#endif
