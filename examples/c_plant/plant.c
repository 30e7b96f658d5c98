/* plant.c: two joints of inertia J without friction or gravity, in a realtime run. In the source tree:
 * lcm-gen -c lcmtypes/[a-z]*.lcm && cc -I. examples/c_plant/plant.c tachless_*.c -llcm -o plant
 * ./plant TICKS PERIOD_S */
#include <lcm/lcm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tachless_participant_t.h"
#include "tachless_position_measurement_t.h"
#include "tachless_tick_t.h"
#include "tachless_torque_command_t.h"
#include "tachless_truth_plant_truth_t.h"

enum { joints = 2, waiting = 0, ready = 1, running = 2, finished = 3, fault = 4 };
static const char *roles[4] = {"plant", "reference", "controller", "logger"};
static const double J[joints] = {3.0, 0.5}; /* [kg m^2] */
static tachless_participant_t me;
static tachless_participant_t others[4]; /* by role; the numbers alone */
static double torque[joints];
static int64_t commanded = -1; /* tick of the newest command */

static double now(void) { /* [s] */
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void on_participant(const lcm_recv_buf_t *buffer, const char *channel,
                           const tachless_participant_t *who, void *user) {
  (void)buffer, (void)channel, (void)user;
  for (int role = 1; role < 4; ++role) {
    if (strcmp(who->role, roles[role]) == 0) others[role] = *who;
  }
  if (me.scenario_digest == 0 && strcmp(who->role, "plant") != 0) {
    me.scenario_digest = who->scenario_digest;
  }
}

static void on_command(const lcm_recv_buf_t *buffer, const char *channel,
                       const tachless_torque_command_t *command, void *user) {
  (void)buffer, (void)channel, (void)user;
  if (command->run != me.run || command->tick != me.tick || command->num_joints != joints) return;
  commanded = command->tick;
  memcpy(torque, command->torque, sizeof torque);
}

/* Handles what comes until `end`, and announces each 100 ms. */
static void listen_until(lcm_t *lcm, double end) {
  static double announced;
  do {
    if (me.scenario_digest != 0 && now() - announced > 0.1) {
      announced = now();
      tachless_participant_t_publish(lcm, "ARM_PARTICIPANT", &me);
    }
    while (lcm_handle_timeout(lcm, 0) > 0) {
    }
    const struct timespec moment = {0, 100000}; /* 0.1 ms */
    nanosleep(&moment, NULL);
  } while (now() < end);
}

/* Announces `state`. */
static void enter(lcm_t *lcm, int8_t state) {
  me.state = state;
  tachless_participant_t_publish(lcm, "ARM_PARTICIPANT", &me);
}

/* Whether reference, controller and logger are all in `state`. */
static int all_are(int8_t state) {
  for (int role = 1; role < 4; ++role) {
    if (others[role].state == fault) exit(3);
    if (others[role].run != me.run || others[role].state != state) return 0;
  }
  return 1;
}

static void meet(lcm_t *lcm) {
  while (!all_are(ready)) listen_until(lcm, now() + 0.01);
  me.roster[0] = me.instance;
  for (int role = 1; role < 4; ++role) me.roster[role] = others[role].instance;
  enter(lcm, ready);
  for (int role = 1; role < 4; ++role) {
    while (memcmp(others[role].roster, me.roster, sizeof me.roster) != 0) {
      listen_until(lcm, now() + 0.001);
      if (others[role].state == fault) exit(3);
    }
  }
  enter(lcm, running);
}

int main(int argc, char **argv) {
  if (argc != 3) return fprintf(stderr, "usage: plant TICKS PERIOD_S\n"), 2;
  const int64_t ticks = atoll(argv[1]);
  const double period = atof(argv[2]);
  lcm_t *lcm = lcm_create(NULL); /* LCM_DEFAULT_URL */
  if (lcm == NULL || ticks < 1 || period <= 0) return 2;
  tachless_participant_t_subscribe(lcm, "ARM_PARTICIPANT", on_participant, NULL);
  tachless_torque_command_t_subscribe(lcm, "ARM_COMMAND", on_command, NULL);
  struct timespec seed;
  clock_gettime(CLOCK_REALTIME, &seed);
  srand48(seed.tv_nsec);
  me.role = "plant";
  me.host = me.scenario = me.law = me.measurement = me.signals = me.fault = "";
  me.instance = (int64_t)lrand48() << 31 | (lrand48() | 1);
  me.run = (int64_t)seed.tv_sec;
  me.tick = -1;
  meet(lcm);

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
