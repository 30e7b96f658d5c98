/* The tick machines of a lock-step run and its end (core/session/tick_master.h, responders.h, log_window.h,
 * core/session/session.cpp: leave), over a network that loses, repeats and reorders; docs/protocol.md, "The model",
 * says what is left out. N ticks are played with rings of DEPTH ticks, a window of W and an acknowledgement
 * every INTERVAL ticks.
 *
 * A message that was sent can be received at any time, any number of times, or never, until the network is
 * `calm`: then what is under way is lost, and all that is sent later arrives once, in any order. From every
 * state that the storm can reach, a calm run has to end well within ROUNDS repeats of the plant.
 * MUTANT=n breaks one rule of the protocol: tests/model/model_test.py expects an error of each.
 * FORGED: another process acknowledges ticks in the logger's name, and announces the plant's end.
 * TRACE: the run of the implementation in the file `trace` is followed, event by event; accepted if `pos` gets
 * to its end. */
#ifndef N
#define N 2
#define W 1
#define DEPTH 3
#define INTERVAL 1
#endif
#define ROUNDS 20
#ifndef MUTANT
#define MUTANT 0
#endif

/* A message of a tick and a receiver of it: one bit of net[tick] (sent) and of has[tick] (received). */
#define TICK_R 1    /* TICK to the reference */
#define MEAS_C 2    /* measurement to the controller */
#define REF_C 4     /* REFERENCE to the controller */
#define COMMAND_P 8 /* COMMAND to the plant */
#define TICK_L 16   /* to the logger */
#define MEAS_L 32
#define REF_L 64
#define COMMAND_L 128
#define STATE_L 256
#define TRUTH_L 512
#define ACK_P 1024 /* in net[n]: ticks 0 to n - 1 are in the log */
#define LOGGED (TICK_L | MEAS_L | REF_L | COMMAND_L | STATE_L | TRUTH_L)
#define REQUEST (TICK_R | TICK_L | MEAS_C | MEAS_L)
#define REPLY (COMMAND_P | COMMAND_L | STATE_L)
short net[N + 1], has[N + DEPTH];
bool calm;

/* Counts: of tick n all before is done. */
byte next, acked;            /* plant: tick that begins next or has begun; acknowledged */
bool asking;                 /* plant: `next` has begun */
byte referred;               /* reference: computed */
byte stepped, law;           /* controller: computed; how often its law has stepped: what its answers depend on */
byte written, newest, ack_newest, ack_written; /* logger: in the log, seen; both at its last ACK */
bool filled_late;

/* How the process is: its part, its end (session::Session::leave), ended well, ended with a fault. */
#define PLANT 0
#define REFERENCE 1
#define CONTROLLER 2
#define LOGGER 3
mtype = {failed, over, leaving, playing}; /* numbered from the last */
mtype status[4] = playing;
byte rounds;

#ifdef TRACE
#include "trace"
short pos; /* LEN events (kind * 64 + tick) * 64 + count after it; kind: 0 begin, else the message's bit */
#define EVENT(kind, tick) (pos < LEN && events[pos] / 64 == (kind) * 64 + (tick)) ->
#define AFTER(count) (events[pos] % 64 == (count)); pos++
#else
#define EVENT(kind, tick) true ->
#define AFTER(count) skip
#endif

#define faulty (status[0] == failed || status[1] == failed || status[2] == failed || status[3] == failed)
#define ended(x) (status[x] == over || status[x] == failed)
/* The ring has dropped the tick for one DEPTH later of which it has something. */
#define too_old(k, bits) (has[k + DEPTH] & (bits))
#define max(a, b) ((a) > (b) -> (a) : (b))
#define min(a, b) ((a) < (b) -> (a) : (b))

#define send(k, bits) net[k] = net[k] | (bits)

inline begin() {
  send(next, REQUEST);
  asking = true
}

inline plant_command(k) {
  assert(k < next || (asking && k == next));
  if
  :: k == next || MUTANT == 1 -> /* fresh: of the present tick */
    assert(stepped > next);
    has[k] = has[k] | COMMAND_P;
    send(next, TRUTH_L);
    asking = false;
    next++
  :: else /* a copy */
  fi
}

inline plant_ack(n) {
  assert(n <= next);
  acked = max(acked, n)
}

/* All up to k + 1 that are not computed, and again what was asked for again. */
inline reference_tick(k) {
  assert(k <= referred);
  if
  :: too_old(k, TICK_R) || k + DEPTH < referred
  :: else ->
    if
    :: ((has[k] & TICK_R) || k + 1 < referred) && MUTANT != 2 ->
      if :: k < referred -> send(k, REF_C | REF_L) :: else fi;
      if :: k + 1 < referred -> send(k + 1, REF_C | REF_L) :: else fi
    :: else
    fi;
    has[k] = has[k] | TICK_R;
    do
    :: referred <= min(k + 1, N - 1) -> send(referred, REF_C | REF_L); referred++
    :: else -> break
    od
  fi
}

inline answer(k) {
  assert(law == stepped); /* else a tick is answered twice, differently */
  send(k, REPLY)
}

inline controller_input(k, what) {
  assert(k <= stepped + (what == REF_C));
  if
  :: too_old(k, MEAS_C | REF_C)
  :: else ->
    if
    :: has[k] & what ->
      if
      :: what == MEAS_C && k < stepped && MUTANT != 3 -> law = law + (MUTANT == 10 -> 1 : 0); answer(k)
      :: else
      fi
    :: else ->
      has[k] = has[k] | what;
      if
      :: stepped < N && (has[stepped] & (MEAS_C | REF_C)) == (MEAS_C | REF_C) ->
        law++;
        stepped++;
        answer(stepped - 1)
      :: else
      fi
    fi
  fi
}

bool late, fresh, asked_again;
inline logger_message(k, what) {
  assert(k < written + DEPTH);
  late = k + 2 < newest;
  fresh = !too_old(k, LOGGED) && !(has[k] & what);
  if :: fresh -> has[k] = has[k] | what; filled_late = filled_late || late :: else fi;
  if :: fresh && what != REF_L -> newest = max(newest, k + 1) :: else fi;
  asked_again = what == TRUTH_L && (late || !fresh) && MUTANT != 4;
  do
  :: written < N && (has[written] & LOGGED) == LOGGED -> written++
  :: else -> break
  od;
  if
  :: asked_again || (filled_late && written > ack_written) || newest - ack_newest >= INTERVAL ||
     (written == N && written > ack_written) ->
    ack_written = (MUTANT == 5 -> newest : written);
    send(ack_written, ACK_P);
    ack_newest = newest;
    filled_late = false
  :: else
  fi;
  late = false; fresh = false; asked_again = false
}

#define IN(what, k, receiver) (net[k] & what) && !ended(receiver) && EVENT(what, k) net[k] = (calm -> net[k] & ~what : net[k])

/* Receptions of the messages of tick k, and of the acknowledgement that k ticks are in the log. */
active [N + 1] proctype Messages() {
  byte k = _pid;
end:
  do
  :: atomic { IN(TICK_R, k, REFERENCE); reference_tick(k); AFTER(referred) }
  :: atomic { IN(MEAS_C, k, CONTROLLER); controller_input(k, MEAS_C); AFTER(stepped) }
  :: atomic { IN(REF_C, k, CONTROLLER); controller_input(k, REF_C); AFTER(stepped) }
  :: atomic { IN(COMMAND_P, k, PLANT); plant_command(k); AFTER(next) }
  :: atomic { IN(TICK_L, k, LOGGER); logger_message(k, TICK_L); AFTER(written) }
  :: atomic { IN(MEAS_L, k, LOGGER); logger_message(k, MEAS_L); AFTER(written) }
  :: atomic { IN(REF_L, k, LOGGER); logger_message(k, REF_L); AFTER(written) }
  :: atomic { IN(COMMAND_L, k, LOGGER); logger_message(k, COMMAND_L); AFTER(written) }
  :: atomic { IN(STATE_L, k, LOGGER); logger_message(k, STATE_L); AFTER(written) }
  :: atomic { IN(TRUTH_L, k, LOGGER); logger_message(k, TRUTH_L); AFTER(written) }
  :: atomic { IN(ACK_P, k, PLANT); plant_ack(k); AFTER(acked) }
#ifdef FORGED
  :: atomic { !asking && k == N && k == next && status[PLANT] == playing -> acked = k }
#endif
  od
}

#define all_there(x) (x == REFERENCE -> referred == N : (x == CONTROLLER -> stepped == N : written == N))
inline end_well(x) {
  assert(x == PLANT || all_there(x));
  assert(x != PLANT || (all_there(1) && all_there(2) && all_there(3)));
  assert(x != PLANT || (status[1] != playing && status[2] != playing && status[3] != playing)); /* all know */
  status[x] = over
}

/* The end of process x: members announce it to each other. */
active [4] proctype End() {
  byte x = _pid - N - 1, y;
#ifdef TRACE
  false;
#endif
end:
  do
  :: atomic { x == PLANT && status[x] == playing && !asking && next == N && acked == N ->
#ifndef FORGED
    assert(written == N);
#endif
    status[x] = leaving
  }
  /* The plant's end counts when this process has all its ticks. */
  :: atomic { x != PLANT && status[x] == playing && (all_there(x) || MUTANT == 6) &&
#ifdef FORGED
      true
#else
      (status[PLANT] == leaving || status[PLANT] == over)
#endif
      -> status[x] = leaving
  }
  /* The plant waits for the others' ends, they for at most a second. */
  :: atomic { x == PLANT && status[x] == leaving &&
      (MUTANT == 7 || ((status[1] == leaving || status[1] == over) && (status[2] == leaving || status[2] == over) &&
                       (status[3] == leaving || status[3] == over))) -> end_well(x)
  }
  :: atomic { x != PLANT && status[x] == leaving -> end_well(x) }
  /* It dies, gives a silent peer up, is interrupted; others follow. */
#ifdef FORGED /* ticks are missing though the plant has finished: all end with a fault */
  :: atomic { !ended(x) && calm -> status[x] = failed }
#endif
  :: atomic { !ended(x) && (!calm || faulty) -> status[x] = failed }
  od
}

active proctype Network() {
  do
  :: atomic { status[PLANT] == playing && !asking && next < N && next - acked < W && EVENT(0, next) begin(); AFTER(next) }
#ifdef TRACE
  :: atomic { pos == LEN -> assert(pos < LEN) } /* accepted */
#else
  :: atomic { !calm -> calm = true;
    for (rounds : 0 .. N) { net[rounds] = 0 }
    rounds = 0
  }
  :: atomic { timeout ->
    if
    :: ended(0) && ended(1) && ended(2) && ended(3) -> break
    :: else ->
      rounds++;
      assert(rounds <= ROUNDS); /* else the run does not end */
      if
      :: asking && MUTANT != 8 -> send(next, REQUEST)
      :: !asking && acked < next -> send(acked, (MUTANT == 9 -> REQUEST : REQUEST | TRUTH_L))
      :: else
      fi
    fi
  }
#endif
  od
}
