/* membership.h: a plant's handshake with reference, controller and logger (docs/protocol.md). */
#include <lcm/lcm.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tachless_participant_t.h"

enum { waiting = 0, ready = 1, running = 2, finished = 3, fault = 4 };
static const char* roles[4] = {"plant", "reference", "controller", "logger"};
static tachless_participant_t me;
static tachless_participant_t others[4]; /* by role; the numbers alone */

static double now(void) { /* [s] */
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void on_participant(const lcm_recv_buf_t* buffer, const char* channel,
                           const tachless_participant_t* who, void* user) {
  (void)buffer, (void)channel, (void)user;
  for (int role = 1; role < 4; ++role) {
    if (strcmp(who->role, roles[role]) == 0) others[role] = *who;
  }
  if (me.scenario_digest == 0 && strcmp(who->role, "plant") != 0) {
    me.scenario_digest = who->scenario_digest;
  }
}

/* Handles messages until `end`, and announces this process each 100 ms. */
static void listen_until(lcm_t* lcm, double end) {
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
static void enter(lcm_t* lcm, int8_t state) {
  me.state = state;
  tachless_participant_t_publish(lcm, "ARM_PARTICIPANT", &me);
}

/* Returns whether reference, controller and logger are all in `state`. */
static int all_are(int8_t state) {
  for (int role = 1; role < 4; ++role) {
    if (others[role].state == fault) exit(3);
    if (others[role].run != me.run || others[role].state != state) return 0;
  }
  return 1;
}

/* Chooses a run and waits until the others have joined it. */
static void join(lcm_t* lcm) {
  struct timespec seed;
  clock_gettime(CLOCK_REALTIME, &seed);
  srand48(seed.tv_nsec);
  tachless_participant_t_subscribe(lcm, "ARM_PARTICIPANT", on_participant, NULL);
  me.role = "plant";
  me.host = me.scenario = me.law = me.measurement = me.signals = me.fault = "";
  me.instance = (int64_t)lrand48() << 31 | (lrand48() | 1);
  me.run = (int64_t)seed.tv_sec;
  me.tick = -1;
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
