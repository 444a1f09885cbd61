/* An importer without any mathematics of its own: co-simulates the unedited cell from two FMI 3.0 libraries and prints every value.
 *
 *     cell_host PLANNER.so TOKEN PLANT.so TOKEN STEPS < references
 *
 * The standard input holds value references, each list with its length in front: of the planner's outputs, of the plant's outputs, of
 * the planner's outputs that are wired, of the plant's inputs they go to. One line per step, values in hexadecimal. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi3FunctionTypes.h"

enum { MOST = 256 };

typedef struct {
    size_t n;
    fmi3ValueReference reference[MOST];
} List;

typedef struct {
    fmi3Instance instance;
    fmi3GetFloat64TYPE *get;
    fmi3SetFloat64TYPE *set;
    fmi3DoStepTYPE *step;
} Slave;

static void check(int ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

static List read_list(void)
{
    List list;
    check(scanf("%zu", &list.n) == 1 && list.n <= MOST, "expected the length of a list");
    for (size_t k = 0; k < list.n; k++) {
        check(scanf("%u", &list.reference[k]) == 1, "expected a value reference");
    }
    return list;
}

static Slave start(const char *library, const char *token)
{
    void *const handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    check(handle != NULL, handle ? "" : dlerror());
    Slave slave;
    fmi3InstantiateCoSimulationTYPE *instantiate;
    fmi3EnterInitializationModeTYPE *enter;
    fmi3ExitInitializationModeTYPE *leave;
    *(void **)&instantiate = dlsym(handle, "fmi3InstantiateCoSimulation");
    *(void **)&enter = dlsym(handle, "fmi3EnterInitializationMode");
    *(void **)&leave = dlsym(handle, "fmi3ExitInitializationMode");
    *(void **)&slave.get = dlsym(handle, "fmi3GetFloat64");
    *(void **)&slave.set = dlsym(handle, "fmi3SetFloat64");
    *(void **)&slave.step = dlsym(handle, "fmi3DoStep");
    slave.instance = instantiate("one", token, NULL, fmi3False, fmi3False, fmi3False, fmi3False, NULL, 0, NULL, NULL, NULL);
    check(slave.instance != NULL, "instantiation is refused");
    check(enter(slave.instance, fmi3False, 0.0, 0.0, fmi3False, 0.0) == fmi3OK, "no initialization mode");
    check(leave(slave.instance) == fmi3OK, "no step mode");
    return slave;
}

int main(int argc, char *argv[])
{
    check(argc == 6, "usage: cell_host PLANNER.so TOKEN PLANT.so TOKEN STEPS");
    const Slave slave[2] = {start(argv[1], argv[2]), start(argv[3], argv[4])};
    const List outputs[2] = {read_list(), read_list()};
    const List from = read_list(), to = read_list();
    double value[MOST];
    for (int n = 0; n < atoi(argv[5]); n++) {
        check(slave[0].get(slave[0].instance, from.reference, from.n, value, from.n) == fmi3OK, "the planner cannot be read");
        check(slave[1].set(slave[1].instance, to.reference, to.n, value, to.n) == fmi3OK, "the plant cannot be set");
        for (int k = 0; k < 2; k++) {
            bool flag[3];
            double time;
            check(slave[k].step(slave[k].instance, n * 1e-3, 1e-3, fmi3True, &flag[0], &flag[1], &flag[2], &time) == fmi3OK, "no step");
        }
        for (int k = 0; k < 2; k++) {
            check(slave[k].get(slave[k].instance, outputs[k].reference, outputs[k].n, value, outputs[k].n) == fmi3OK, "no outputs");
            for (size_t i = 0; i < outputs[k].n; i++) {
                printf("%a ", value[i]);
            }
        }
        printf("\n");
    }
    return 0;
}
