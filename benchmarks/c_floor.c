// What the engine costs with no Python at all: mj_step in a loop, over a workload's simulations.
#include <mujoco/mujoco.h>

void c_floor(const mjModel* m, mjData* d, int nbatch, int nstep, const mjtNum* initial_state,
             const mjtNum* control, mjtNum* final_state) {
  int nstate = mj_stateSize(m, mjSTATE_INTEGRATION);
  for (int i = 0; i < nbatch; i++) {
    mj_setState(m, d, initial_state + i * nstate, mjSTATE_INTEGRATION);
    for (int k = 0; k < nstep; k++) {
      mju_copy(d->ctrl, control, m->nu);
      control += m->nu;
      mj_step(m, d);
    }
    mj_getState(m, d, final_state + i * nstate, mjSTATE_INTEGRATION);
  }
}
