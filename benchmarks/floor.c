/* The floor of the speed benchmark: the recursion of dc_motor.fmu (three states, held voltage) and the weighted error
 * sum of current and speed, in plain C, with no FMI between. The step matrix is given, as the FMU has it after its
 * first step. */
#include <stdint.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* transition: 3x3, E - I by rows; gain: 3; returns the cost of `candidates` runs over `samples` samples. */
EXPORT double floor_run(int64_t candidates, int64_t samples, const double *transition, const double *gain,
                        const double *voltage, const double *measured, const double *weights)
{
    double total = 0;
    for (int64_t c = 0; c < candidates; c++) {
        double i = 0, w = 0, angle = 0, cost = 0;
        for (int64_t k = 0; k < samples; k++) {
            const double ei = i - measured[2 * k];
            const double ew = w - measured[2 * k + 1];
            cost += weights[0] * (ei * ei);
            cost += weights[1] * (ew * ew);
            const double v = voltage[k];
            const double di = transition[0] * i + transition[1] * w + transition[2] * angle + gain[0] * v;
            const double dw = transition[3] * i + transition[4] * w + transition[5] * angle + gain[1] * v;
            const double da = transition[6] * i + transition[7] * w + transition[8] * angle + gain[2] * v;
            i += di;
            w += dw;
            angle += da;
        }
        total += cost;
    }
    return total;
}
