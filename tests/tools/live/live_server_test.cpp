// The server of the live page, as browsers and other programs of this computer reach it.

#include "live/live_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <deque>
#include <string>
#include <string_view>

#include "base/failure.h"

namespace tachless::live {
namespace {

using base::Clock;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// A connection to the server, which the test serves in its own thread.
class Caller {
 public:
  explicit Caller(LiveServer& server)
      : server_(server), socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    port_ = std::stoi(server.url().substr(server.url().rfind(':') + 1));
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port_));
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    EXPECT_EQ(connect(socket_.get(), reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
  }

  void send(std::string_view text) {
    ::send(socket_.get(), text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    serve();
  }
  void ask(const std::string& path, const std::string& headers = {},
           const std::string& method = "GET") {
    send(method + " " + path + " HTTP/1.1\r\nHost: localhost:" + std::to_string(port_) + "\r\n" +
         headers + "\r\n");
  }
  /// All that has come so far.
  const std::string& received() {
    serve();
    std::array<char, 65536> buffer;
    for (ssize_t got = 1; got > 0;) {
      got = recv(socket_.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (got > 0) text_.append(buffer.data(), static_cast<std::size_t>(got));
      if (got == 0 || (got < 0 && errno == ECONNRESET)) closed_ = true;
      if (got > 0) serve();
    }
    return text_;
  }
  bool closed() {
    received();
    return closed_;
  }

 private:
  void serve() {
    for (int i = 0; i < 3; ++i) server_.serve(Clock::now());
  }

  LiveServer& server_;
  base::FileDescriptor socket_;
  int port_ = 0;
  std::string text_;
  bool closed_ = false;
};

class TheLiveServer : public testing::Test {
 protected:
  TheLiveServer() { server.begin("ARM", "the page of the arm"); }
  std::string answer(const std::string& path, const std::string& headers = {},
                     const std::string& method = "GET") {
    Caller caller(server);
    caller.ask(path, headers, method);
    return caller.received();
  }
  LiveServer server{0};
};

TEST_F(TheLiveServer, GivesThePageAndItsEvents) {
  EXPECT_THAT(answer("/"), AllOf(StartsWith("HTTP/1.1 200 "), HasSubstr("the page of the arm")));
  EXPECT_THAT(answer("/?robot=ARM"), HasSubstr("the page of the arm"));
  server.add("ARM", "{\"number\":1}");
  Caller stream(server);
  stream.ask("/events?robot=ARM");
  EXPECT_THAT(stream.received(), HasSubstr("data: {\"number\":1}\n\n"));
  server.add("ARM", "{\"number\":2}");
  EXPECT_THAT(stream.received(), HasSubstr("data: {\"number\":2}\n\n"));
  EXPECT_FALSE(stream.closed());
}

TEST_F(TheLiveServer, GivesThePageBesideAsManyStreamsAsThereMayBe) {
  std::deque<Caller> streams;
  for (std::size_t i = 0; i < LiveServer::most_streams; ++i) {
    streams.emplace_back(server).ask("/events?robot=ARM");
    EXPECT_THAT(streams.back().received(), StartsWith("HTTP/1.1 200 "));
  }
  EXPECT_THAT(answer("/events?robot=ARM"), StartsWith("HTTP/1.1 503 "));
  EXPECT_THAT(answer("/"), HasSubstr("the page of the arm"));
  streams.pop_front();
  EXPECT_THAT(answer("/events?robot=ARM"), StartsWith("HTTP/1.1 200 ")) << "one has gone";
}

TEST_F(TheLiveServer, RefusesMoreConnectionsThanItKeeps) {
  LiveServer patient(0, std::chrono::hours(1));
  std::deque<Caller> slow;
  for (std::size_t i = 0; i < LiveServer::most_connections; ++i) {
    slow.emplace_back(patient).send("G");
  }
  Caller further(patient);
  EXPECT_THAT(further.received(), StartsWith("HTTP/1.1 503 "));
  EXPECT_TRUE(further.closed());
}

TEST_F(TheLiveServer, EndsAConnectionWhoseRequestIsNotWholeInTime) {
  LiveServer impatient(0, std::chrono::milliseconds(0));
  Caller slow(impatient);
  slow.send("GET / HTTP/1.1\r\n");
  EXPECT_TRUE(slow.closed());
}

TEST_F(TheLiveServer, GivesNoRanges) {
  std::string ranges = "Range: bytes=0-";
  while (ranges.size() < 4000) ranges += ",0-";
  const std::string whole = answer("/", ranges + "\r\n");
  EXPECT_THAT(whole, StartsWith("HTTP/1.1 200 "));
  EXPECT_LT(whole.size(), 1000U);
}

TEST_F(TheLiveServer, RefusesHeadersWithoutEnd) {
  Caller caller(server);
  caller.send("GET / HTTP/1.1\r\n");
  for (int i = 0; i < 20 && !caller.closed(); ++i) caller.send(std::string(1000, 'a'));
  EXPECT_THAT(caller.received(), StartsWith("HTTP/1.1 431 "));
  EXPECT_TRUE(caller.closed());
}

TEST_F(TheLiveServer, RefusesOtherHostsMethodsBodiesAndWhatIsNoRequest) {
  Caller other(server);
  other.send("GET / HTTP/1.1\r\nHost: attacker.example\r\n\r\n");
  EXPECT_THAT(other.received(), AllOf(StartsWith("HTTP/1.1 403 "), Not(HasSubstr("the page"))));
  EXPECT_THAT(answer("/", "Host: attacker.example\r\n"), StartsWith("HTTP/1.1 400 "));
  EXPECT_THAT(answer("/", {}, "POST"), StartsWith("HTTP/1.1 405 "));
  EXPECT_THAT(answer("/", "Content-Length: 5\r\n"), StartsWith("HTTP/1.1 413 "));
  EXPECT_THAT(answer("/../etc/passwd"), StartsWith("HTTP/1.1 404 "));
  EXPECT_THAT(answer("/events?robot=OTHER"), StartsWith("HTTP/1.1 404 "));
  for (const char* text : {"\r\n\r\n", "GET /\r\n\r\n", "GET / HTTP/2\r\n\r\n",
                           "GET / HTTP/1.1\r\nno colon\r\n\r\n", "a b c d\r\n\r\n"}) {
    Caller caller(server);
    caller.send(text);
    EXPECT_THAT(caller.received(), StartsWith("HTTP/1.1 400 ")) << text;
    EXPECT_TRUE(caller.closed());
  }
}

TEST_F(TheLiveServer, KeepsABoundedNumberOfBytesOfAllRobots) {
  const std::string stretch(1'000'000, 'x');
  server.begin("SECOND", "another page");
  for (int i = 0; i < 100; ++i) {
    server.add("ARM", stretch);
    server.add("SECOND", stretch);
  }
  Caller stream(server);
  stream.ask("/events?robot=ARM");
  while (stream.received().size() < LiveServer::kept_bytes / 4) continue;
  EXPECT_LE(stream.received().size(), LiveServer::kept_bytes);
}

TEST_F(TheLiveServer, RefusesAPortThatIsTaken) {
  EXPECT_THROW(LiveServer(std::stoi(server.url().substr(server.url().rfind(':') + 1))),
               base::Failure);
}

}  // namespace
}  // namespace tachless::live
