/*
 * Time of mj_step without and with the plugin: bench PLUGIN MODEL.json ...
 *
 * One instrument on a slide joint, pushed to and fro through the seal; the same scene without a trocar is the first row. A
 * million steps each, in ns: median, 99.9 %, worst.
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <mujoco/mujoco.h>

enum { STEPS = 1000000, WARM_UP = 10000 };

static const char *const SCENE =
    "<mujoco><option timestep='0.001' integrator='implicitfast' gravity='0 0 0'/>%s"
    "<worldbody><body><joint name='insertion' type='slide' axis='0 0 1' stiffness='20'/>"
    "<geom type='capsule' size='0.005 0.1' mass='0.3'/></body></worldbody></mujoco>";
static const char *const TROCAR =
    "<extension><plugin plugin='trocar'><instance name='port'><config key='model' value='%s'/>"
    "<config key='joint' value='insertion'/></instance></plugin></extension>";

static mjModel *load(const char *model)
{
    static char extension[4096];
    static char xml[8192];
    char error[1024] = "";
    mjVFS vfs;
    mjModel *scene;

    extension[0] = '\0';
    if (model != NULL) {
        snprintf(extension, sizeof extension, TROCAR, model);
    }
    snprintf(xml, sizeof xml, SCENE, extension);
    mj_defaultVFS(&vfs);
    mj_addBufferVFS(&vfs, "scene.xml", xml, (int)strlen(xml));
    scene = mj_loadXML("scene.xml", &vfs, error, sizeof error);
    mj_deleteVFS(&vfs);
    if (scene == NULL) {
        fprintf(stderr, "%s\n", error);
        exit(1);
    }
    return scene;
}

static double now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a;
    const double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Steps the scene and prints its row of the table. */
static void measure(const char *name, mjModel *scene, double *times_ns)
{
    mjData *d = mj_makeData(scene);
    double least_m = 0.0;
    double most_m = 0.0;
    int step;

    for (step = -WARM_UP; step < STEPS; step++) {
        const double start_ns = now_ns();
        d->qfrc_applied[0] = 8.0 * sin(6.0 * d->time) + 0.3 * sin(60.0 * d->time);
        mj_step(scene, d);
        if (step >= 0) {
            times_ns[step] = now_ns() - start_ns;
        }
        least_m = fmin(least_m, d->qpos[0]);
        most_m = fmax(most_m, d->qpos[0]);
    }
    qsort(times_ns, STEPS, sizeof *times_ns, ascending);
    printf("| %s | %.0f | %.0f | %.0f | %.0f |\n", name, times_ns[STEPS / 2], times_ns[STEPS - STEPS / 1000],
           times_ns[STEPS - 1], 1e3 * (most_m - least_m));
    fflush(stdout);
    mj_deleteData(d);
    mj_deleteModel(scene);
}

int main(int argc, char **argv)
{
    double *times_ns = malloc(STEPS * sizeof *times_ns);
    int i;

    if (argc < 3 || times_ns == NULL) {
        fprintf(stderr, "usage: bench PLUGIN MODEL.json ...\n");
        return 2;
    }
    mj_loadPluginLibrary(argv[1]);
    printf("MuJoCo %s, %d steps of mj_step each\n", mj_versionString(), STEPS);
    printf("| trocar | median (ns) | 99.9 %% (ns) | worst (ns) | travel (mm) |\n|---|---|---|---|---|\n");
    measure("none", load(NULL), times_ns);
    for (i = 2; i < argc; i++) {
        const char *slash = strrchr(argv[i], '/');
        char name[64];
        snprintf(name, sizeof name, "%s", slash != NULL ? slash + 1 : argv[i]);
        name[strcspn(name, ".")] = '\0';
        measure(name, load(argv[i]), times_ns);
    }
    free(times_ns);
    return 0;
}
