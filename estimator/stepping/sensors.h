/* sensors: what a sensor shows of an output, sample by sample. Included by stepper.c; knows no FMI.
 *
 *     output --(mean over the interval)--> mean of the last n samples --> filter --> gain x + offset --> shown
 *
 * Before the first sample everything is as in the first sample, and a filter's state is zero. Candidates may carry
 * their own sensor values, after the FMU's parameters: the delay of the response behind the inputs, then gain, offset
 * and a further delay of every output. Delays are exact: timed.h steps to the instants that they mean.
 */
#ifndef SENSORS_H
#define SENSORS_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* How a sensor shows an output. MEAN: the output is an integral (an angle), the sensor shows its mean derivative
   over the sampling interval that ends at the sample. */
enum { IDENTITY = 0, MEAN = 1 };

enum { MAX_AVERAGE = 256, MAX_SECTIONS = 16 };

typedef struct {
    int64_t average;                           /* samples; 1: none */
    int64_t sections;                          /* of second order; 0: no filter */
    double section[MAX_SECTIONS][5];           /* b0 b1 b2 a1 a2 */
} Chain;

typedef struct {
    double before;                             /* MEAN: the integral one sample ago */
    double last[MAX_AVERAGE];                  /* ring of the last `average` samples */
    double state[MAX_SECTIONS][2];             /* transposed direct form II */
} ChainState;

/* What the sensor shows at sample k of an output that reads `read`. */
static inline double sensor_shows(const Chain *chain, ChainState *state, int64_t kind, double interval, int64_t k,
                                  double read) {
    double x = read;
    if (k == 0) memset(state->state, 0, sizeof state->state);
    if (kind == MEAN) {
        x = k == 0 ? 0.0 : (read - state->before) / interval;
        state->before = read;
    }
    if (chain == NULL) return x;
    if (chain->average > 1) {
        const int64_t n = chain->average;
        double sum = 0.0;
        if (k == 0)
            for (int64_t j = 0; j < n; j++) state->last[j] = x;
        state->last[k % n] = x;
        for (int64_t j = 0; j < n; j++) sum += state->last[j];
        x = sum / (double)n;
    }
    for (int64_t s = 0; s < chain->sections; s++) {
        const double *c = chain->section[s];
        double *z = state->state[s];
        const double y = c[0] * x + z[0];
        z[0] = c[1] * x - c[3] * y + z[1];
        z[1] = c[2] * x - c[4] * y;
        x = y;
    }
    return x;
}

#endif
