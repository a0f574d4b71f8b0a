/* Times of LinuxCNC's kinematics of a hexapod: its own module's, and ours. The same poses on
 * straight paths, each asked from the one before; and the inverse. The fastest of some repeats.
 *
 *   cc -O2 -rdynamic packages/linuxcnc/tests/trials/forward_times.c
 * packages/linuxcnc/tests/stub_hal.c -ldl -lm \ -o forward
 *   ./forward 40 packages/linuxcnc/hal/truepose_kins.so      # tilts up to 40 degrees */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { POSES = 1000, STEPS = 40, REPEATS = 15 };

typedef struct {
  double x[9];
} pose;
typedef int (*forward)(const double*, pose*, const unsigned long*, unsigned long*);
typedef int (*inverse)(const pose*, double*, const unsigned long*, unsigned long*);

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e9 * t.tv_sec + t.tv_nsec;
}
static double within(double range) { return range * (2.0 * rand() / RAND_MAX - 1); }
static int larger(const void* a, const void* b) {
  return (*(const double*)a > *(const double*)b) - (*(const double*)a < *(const double*)b);
}

static double joints[POSES][16];
static pose asked[POSES];

static void judge(const char* name, void* module) {
  const forward fk = (forward)dlsym(module, "kinematicsForward");
  const inverse ik = (inverse)dlsym(module, "kinematicsInverse");
  static double took[2][POSES];
  int failed = 0, wrong = 0;
  unsigned long flags[4] = {0};
  for (int k = 1; k < POSES; ++k) {
    took[0][k] = took[1][k] = HUGE_VAL;
    for (int r = 0; r < REPEATS; ++r) {
      pose at = asked[k - 1];
      double legs[16], off = 0;
      fk(joints[k - 1], &at, flags, flags); /* from the pose before */
      const double begun = now();
      const int result = fk(joints[k], &at, flags, flags);
      const double between = now();
      ik(&asked[k], legs, flags, flags);
      took[1][k] = fmin(took[1][k], now() - between);
      took[0][k] = fmin(took[0][k], between - begun);
      if (r > 0) continue;
      for (int i = 0; i < 6; ++i) off = fmax(off, fabs(at.x[i] - asked[k].x[i]));
      failed += result != 0;
      wrong += result == 0 && off > 1e-6;
    }
  }
  for (int what = 0; what < 2; ++what) {
    qsort(took[what] + 1, POSES - 1, sizeof **took, larger);
    printf("%-14s %s: median %6.0f ns, worst %6.0f ns\n", name, what ? "inverse" : "forward",
           took[what][POSES / 2], took[what][POSES - 1]);
  }
  printf("%-14s of %d poses %d failed, %d wrong\n", name, POSES - 1, failed, wrong);
}

int main(int count, char** words) {
  const double most = count > 1 ? atof(words[1]) : 40;
  const char* path = count > 2 ? words[2] : "packages/linuxcnc/hal/truepose_kins.so";
  void* stock = dlopen("/usr/lib/linuxcnc/modules/genhexkins.so", RTLD_NOW);
  void* own = dlopen(path, RTLD_NOW);
  if (stock == NULL || own == NULL) return printf("%s\n", dlerror()), 1;
  *(const char**)*(void**)dlsym(own, "rtapi_info_address_pins") = "genhexkins";
  if (((int (*)(void))dlsym(stock, "rtapi_app_main"))() != 0 ||
      ((int (*)(void))dlsym(own, "rtapi_app_main"))() != 0)
    return 1;
  inverse legs = (inverse)dlsym(own, "kinematicsInverse");
  unsigned long flags[4] = {0};
  double from[6] = {0}, to[6] = {0};
  srand(1);
  for (int k = 0; k < POSES; ++k) { /* straight paths of STEPS cycles between random poses */
    if (k % STEPS == 0)
      for (int i = 0; i < 6; ++i) from[i] = to[i], to[i] = within(i < 3 ? 3 : most);
    memset(&asked[k], 0, sizeof asked[k]);
    for (int i = 0; i < 6; ++i)
      asked[k].x[i] = from[i] + (to[i] - from[i]) * (k % STEPS) / STEPS + (i == 2 ? 20 : 0);
    if (legs(&asked[k], joints[k], flags, flags) !=
        0) { /* no pose of it: another path, from home */
      memset(to, 0, sizeof to);
      k -= k % STEPS + 1;
    }
  }
  judge("genhexkins", stock);
  judge("truepose_kins", own);
  return 0;
}
