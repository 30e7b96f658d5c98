// Preloaded into Slurm's daemons, which drop supplementary groups when they start: in a user
// namespace, where tests run, nobody may, and there are none to drop.
#include <sys/types.h>

extern "C" {
int setgroups(size_t /*count*/, const gid_t* /*groups*/) { return 0; }
int initgroups(const char* /*user*/, gid_t /*group*/) { return 0; }
}
