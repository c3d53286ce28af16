// stop_child SOCKET: serves a volume on the socket until it is killed. stop_served_test.cpp runs
// it.
#include <unistd.h>

#include <cstdio>

#include "tests/support/served_session.h"

int main(int, char** argv) {
  palpate::testing::ServedSession served(argv[1]);
  served.server().Reserve();
  served.data().Load("builtin:sphere:16");
  served.data().Start();
  served.server().Start();
  std::puts("ready");
  std::fflush(stdout);
  while (true) pause();
}
