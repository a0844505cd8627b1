/* Steps an FMI 2.0 FMU's library, for machines that have no importer here: steps LIBRARY GUID VARIABLES.
 *
 * The first variable, an input, jumps every tenth step; the values of all variables, those with the first value
 * references, are printed after every step of 1 ms, as hexadecimal floating-point numbers.
 */
#include "fmi2Functions.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

#define STEPS 200
#define MOST 64

#define FUNCTION(name) name##TYPE *name = (name##TYPE *)(size_t)dlsym(library, #name)

int main(int count, char **arguments)
{
    const double levels[] = {0, 3, 9, -9, 0.2, 0};
    void *library = count > 3 ? dlopen(arguments[1], RTLD_NOW) : NULL;
    fmi2CallbackFunctions functions = {NULL, calloc, free, NULL, NULL};
    fmi2ValueReference references[MOST];
    double values[MOST];
    if (library == NULL) return fprintf(stderr, "%s\n", count > 3 ? dlerror() : "steps LIBRARY GUID VARIABLES"), 2;
    const size_t variables = strtoul(arguments[3], NULL, 10);
    FUNCTION(fmi2Instantiate);
    FUNCTION(fmi2SetupExperiment);
    FUNCTION(fmi2EnterInitializationMode);
    FUNCTION(fmi2ExitInitializationMode);
    FUNCTION(fmi2SetReal);
    FUNCTION(fmi2DoStep);
    FUNCTION(fmi2GetReal);
    FUNCTION(fmi2FreeInstance);
    fmi2Component motor = fmi2Instantiate("motor", fmi2CoSimulation, arguments[2], NULL, &functions, 0, 0);
    if (motor == NULL || variables > MOST) return 3;
    for (unsigned int k = 0; k < MOST; k++) references[k] = k;
    if (fmi2SetupExperiment(motor, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(motor) ||
        fmi2ExitInitializationMode(motor))
        return 4;
    for (int k = 0; k < STEPS; k++) {
        const double level = levels[k / 10 % 6];
        if (fmi2SetReal(motor, references, 1, &level) || fmi2DoStep(motor, k * 1e-3, 1e-3, 1)) return 5;
        if (fmi2GetReal(motor, references, variables, values)) return 6;
        for (size_t n = 0; n < variables; n++) printf("%a ", values[n]);
        printf("\n");
    }
    fmi2FreeInstance(motor);
    return 0;
}
