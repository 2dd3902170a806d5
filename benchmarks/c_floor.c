// The cost of the engine without Python: mj_step in a loop over the simulations of a workload.
//
// Arrays are row by row: initial_state and final_state (nbatch, nstate) of mjSTATE_INTEGRATION,
// control (nbatch, nstep, nu). If state is not NULL, the physics state after each step goes to state
// (nbatch, nstep, nphysics) and, if sensordata is not NULL, its sensors to sensordata (nbatch, nstep,
// nsensordata), as mujoco.rollout returns them; controls are then set as mujoco.rollout sets them.
#include <mujoco/mujoco.h>

void c_floor(const mjModel* m, mjData* d, int nbatch, int nstep, const mjtNum* initial_state,
             const mjtNum* control, mjtNum* final_state, mjtNum* state, mjtNum* sensordata) {
  int nstate = mj_stateSize(m, mjSTATE_INTEGRATION);
  int nphysics = mj_stateSize(m, mjSTATE_FULLPHYSICS);
  for (int i = 0; i < nbatch; i++) {
    mj_setState(m, d, initial_state + i * nstate, mjSTATE_INTEGRATION);
    for (int k = 0; k < nstep; k++) {
      if (state) {
        mj_setState(m, d, control, mjSTATE_CTRL);
      } else {
        mju_copy(d->ctrl, control, m->nu);
      }
      control += m->nu;
      mj_step(m, d);
      if (state) {
        mj_getState(m, d, state, mjSTATE_FULLPHYSICS);
        state += nphysics;
        if (sensordata) {
          mju_copy(sensordata, d->sensordata, m->nsensordata);
          sensordata += m->nsensordata;
        }
      }
    }
    mj_getState(m, d, final_state + i * nstate, mjSTATE_INTEGRATION);
  }
}
