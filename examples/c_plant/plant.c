/* plant.c: two joints of inertia J without friction or gravity, in a realtime run. In the source tree:
 * lcm-gen -c lcmtypes/[a-z]*.lcm && cc -I. examples/c_plant/plant.c tachless_*.c -llcm -o plant
 * ./plant TICKS PERIOD_S */
#include <stdio.h>

#include "membership.h"
#include "tachless_position_measurement_t.h"
#include "tachless_tick_t.h"
#include "tachless_torque_command_t.h"
#include "tachless_truth_plant_truth_t.h"

enum { joints = 2 };
static const double J[joints] = {3.0, 0.5}; /* [kg m^2] */
static double torque[joints];
static int64_t commanded = -1; /* tick of the newest command */

static void on_command(const lcm_recv_buf_t *buffer, const char *channel,
                       const tachless_torque_command_t *command, void *user) {
  (void)buffer, (void)channel, (void)user;
  if (command->run != me.run || command->tick != me.tick || command->num_joints != joints) return;
  commanded = command->tick;
  memcpy(torque, command->torque, sizeof torque);
}

int main(int argc, char **argv) {
  if (argc != 3) return fprintf(stderr, "usage: plant TICKS PERIOD_S\n"), 2;
  const int64_t ticks = atoll(argv[1]);
  const double period = atof(argv[2]);
  lcm_t *lcm = lcm_create(NULL); /* LCM_DEFAULT_URL */
  if (lcm == NULL || ticks < 1 || period <= 0) return 2;
  tachless_torque_command_t_subscribe(lcm, "ARM_COMMAND", on_command, NULL);
  join(lcm);

  double q[joints] = {0}, v[joints] = {0}, none[joints] = {0};
  int8_t no_flag[joints] = {0};
  const double start = now() + 0.005;
  for (int64_t k = 0; k < ticks; ++k) {
    listen_until(lcm, start + (double)k * period);
    const int missed = k > 0 && commanded != k - 1; /* the last torque is held */
    double applied[joints]; /* what is commanded from now on acts over tick k + 1 */
    memcpy(applied, torque, sizeof applied);
    me.tick = k;
    const int64_t utime = (int64_t)(1e6 * (double)k * period + 0.5);
    const tachless_position_measurement_t position = {utime, me.run, k, joints, q};
    tachless_position_measurement_t_publish(lcm, "ARM_POSITION", &position);
    const tachless_tick_t tick = {(int64_t)(1e6 * (now() - start)), me.run, k, k + 1 == ticks};
    tachless_tick_t_publish(lcm, "ARM_TICK", &tick);
    const tachless_truth_plant_truth_t truth = {utime, me.run, k,    joints, 0,       q,     v,
                                                NULL,  NULL,   applied, none,   no_flag, missed};
    tachless_truth_plant_truth_t_publish(lcm, "ARM_TRUTH", &truth);
    for (int i = 0; i < joints; ++i) { /* exact for a torque that is held */
      q[i] += v[i] * period + 0.5 * applied[i] / J[i] * period * period;
      v[i] += applied[i] / J[i] * period;
    }
  }
  enter(lcm, finished);
  for (const double end = now() + 5; now() < end && !all_are(finished);) {
    listen_until(lcm, now() + 0.02);
    enter(lcm, finished);
  }
  lcm_destroy(lcm);
  return all_are(finished) ? 0 : 3;
}
