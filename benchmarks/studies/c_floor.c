// The cost of the engine without Python: a program that loops mj_step over the simulations of a
// workload, on the library of MuJoCo's Python package.
//
//     c_floor MODEL.mjb WORKLOAD.bin
//
// WORKLOAD.bin: five int64 (simulations, controls of each, steps per control, whether to store the
// state after each step, and whether its sensors), then doubles: initial states (nbatch, nstate) of
// mjSTATE_INTEGRATION, and controls (nbatch, ncontrol, nu).
//
// A line on stdin is one command:
//   plain   run a block; prints its nanoseconds
//   timer   the same with an mjcb_time like the one that the Python package installs
//   states  prints the final states (nbatch, nstate) of the last block, as doubles
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <mujoco/mujoco.h>

typedef struct {
  int64_t nbatch, ncontrol, hold, stores_state, stores_sensors;
} Sizes;

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return 1000000000 * (int64_t)now.tv_sec + now.tv_nsec;
}

static int64_t timer_begin_ns;

// What the Python package's function computes with std::chrono::steady_clock: seconds since a start.
static mjtNum timer(void) { return (now_ns() - timer_begin_ns) / 1e9; }

static void fail(const char* what) {
  fprintf(stderr, "c_floor: %s\n", what);
  exit(1);
}

static mjtNum* new_array(int64_t n) {
  mjtNum* array = malloc((n ? n : 1) * sizeof(mjtNum));
  if (!array) fail("out of memory");
  memset(array, 0, n * sizeof(mjtNum));  // touches all of it
  return array;
}

static mjtNum* read_array(FILE* file, int64_t n) {
  mjtNum* array = new_array(n);
  if (fread(array, sizeof(mjtNum), n, file) != (size_t)n) fail("the workload is too short");
  return array;
}

// Step all simulations. A step that is stored has its control set as mujoco.rollout sets it.
static void run(const mjModel* m, mjData* d, Sizes s, const mjtNum* initial_state,
                const mjtNum* control, mjtNum* final_state, mjtNum* state, mjtNum* sensordata) {
  int nstate = mj_stateSize(m, mjSTATE_INTEGRATION);
  int nphysics = mj_stateSize(m, mjSTATE_FULLPHYSICS);
  for (int64_t i = 0; i < s.nbatch; i++) {
    mj_setState(m, d, initial_state + i * nstate, mjSTATE_INTEGRATION);
    for (int64_t k = 0; k < s.ncontrol; k++, control += m->nu) {
      if (!s.stores_state) mju_copy(d->ctrl, control, m->nu);
      for (int64_t h = 0; h < s.hold; h++) {
        if (s.stores_state) mj_setState(m, d, control, mjSTATE_CTRL);
        mj_step(m, d);
        if (s.stores_state) {
          mj_getState(m, d, state, mjSTATE_FULLPHYSICS);
          state += nphysics;
        }
        if (s.stores_sensors) {
          mju_copy(sensordata, d->sensordata, m->nsensordata);
          sensordata += m->nsensordata;
        }
      }
    }
    mj_getState(m, d, final_state + i * nstate, mjSTATE_INTEGRATION);
  }
}

int main(int argc, char** argv) {
  if (argc != 3) fail("expected MODEL.mjb and WORKLOAD.bin");
  mjModel* m = mj_loadModel(argv[1], NULL);
  if (!m) fail("cannot load the model");
  mjData* d = mj_makeData(m);
  FILE* file = fopen(argv[2], "rb");
  Sizes s;
  if (!d || !file || fread(&s, sizeof(s), 1, file) != 1) fail("cannot read the workload");
  int64_t nstate = mj_stateSize(m, mjSTATE_INTEGRATION), nstep = s.nbatch * s.ncontrol * s.hold;
  mjtNum* initial_state = read_array(file, s.nbatch * nstate);
  mjtNum* control = read_array(file, s.nbatch * s.ncontrol * m->nu);
  mjtNum* final_state = new_array(s.nbatch * nstate);
  mjtNum* state = new_array(s.stores_state * nstep * mj_stateSize(m, mjSTATE_FULLPHYSICS));
  mjtNum* sensordata = new_array(s.stores_sensors * nstep * m->nsensordata);
  if (fgetc(file) != EOF) fail("the workload is too long");

  char line[16];
  while (fgets(line, sizeof(line), stdin)) {
    if (!strcmp(line, "states\n")) {
      fwrite(final_state, sizeof(mjtNum), s.nbatch * nstate, stdout);
    } else {
      timer_begin_ns = now_ns();
      mjcb_time = strcmp(line, "timer\n") ? NULL : timer;
      int64_t begin = now_ns();
      run(m, d, s, initial_state, control, final_state, state, sensordata);
      printf("%lld\n", (long long)(now_ns() - begin));
    }
    fflush(stdout);
  }
  return 0;
}
