#include "live/live_server.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <optional>
#include <utility>
#include <vector>

#include "base/failure.h"
#include "report/html.h"

namespace tachless::live {
namespace {

using base::Clock;

constexpr const char* address = "127.0.0.1";
constexpr std::string_view end_of_headers = "\r\n\r\n";

/// Returns a page that reloads itself until there is a run.
std::string waiting_page(const report::Html& text) {
  return report::
      html("<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><meta http-equiv=\"refresh\" "
           "content=\"1\"><title>tachless</title><p>{}</p></html>\n",
           text)
          .markup();
}

/// The parts of a request that the server uses.
struct Request {
  std::string_view method, path, query, version, host;
  bool has_body = false;
};

bool same_word(std::string_view a, std::string_view b) {
  return std::ranges::equal(
      a, b, [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

/// Returns nullopt if the text is not a request of HTTP/1.0 or 1.1 with one host name.
std::optional<Request> parse(std::string_view text) {
  Request request;
  const auto take_line = [&] {
    const auto end = text.find("\r\n");
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end + 2);
    return line;
  };
  const std::string_view line = take_line();
  const auto space = line.find(' '), last = line.rfind(' ');
  if (space == line.npos || space == last) return std::nullopt;
  request.method = line.substr(0, space);
  request.version = line.substr(last + 1);
  if (request.version != "HTTP/1.1" && request.version != "HTTP/1.0") return std::nullopt;
  const std::string_view target = line.substr(space + 1, last - space - 1);
  const auto mark = target.find('?');
  request.path = target.substr(0, mark);
  if (mark != target.npos) request.query = target.substr(mark + 1);
  int hosts = 0;
  while (!text.starts_with("\r\n")) {
    const std::string_view header = take_line();
    const auto colon = header.find(':');
    if (colon == header.npos) return std::nullopt;
    const std::string_view name = header.substr(0, colon),
                           value = trimmed(header.substr(colon + 1));
    if (same_word(name, "Host")) {
      request.host = value;
      ++hosts;
    }
    request.has_body |=
        same_word(name, "Transfer-Encoding") || (same_word(name, "Content-Length") && value != "0");
  }
  if (hosts > 1) return std::nullopt;
  return request;
}

/// Returns the value of "robot" in a query. Names of robots need no decoding.
std::string robot_in(std::string_view query) {
  while (!query.empty()) {
    const std::string_view part = query.substr(0, query.find('&'));
    if (part.starts_with("robot=")) return std::string(part.substr(6));
    query.remove_prefix(std::min(query.size(), part.size() + 1));
  }
  return {};
}

/// Returns status line and headers of an answer. The body ends with the connection.
std::string head(std::string_view status, std::string_view content_type,
                 std::optional<std::size_t> size) {
  return fmt::format(
      "HTTP/1.1 {}\r\nContent-Type: {}\r\n{}Connection: close\r\nAccept-Ranges: none\r\n"
      "Cache-Control: no-store\r\nCross-Origin-Resource-Policy: same-origin\r\n"
      "X-Content-Type-Options: nosniff\r\nX-Frame-Options: SAMEORIGIN\r\n\r\n",
      status, content_type, size ? fmt::format("Content-Length: {}\r\n", *size) : "");
}

/// Reads what a browser has sent beyond its request. Closing a socket with unread bytes would reset
/// the connection, and the browser would lose the answer.
void discard_input(int socket) {
  std::array<char, 4096> ignored;
  for (int i = 0; i < 16 && recv(socket, ignored.data(), ignored.size(), 0) > 0; ++i) continue;
}

std::string refusal(std::string_view status) {
  return head(status, "text/plain; charset=utf-8", 0);
}

}  // namespace

LiveServer::LiveServer(int port, std::chrono::milliseconds longest_asking)
    : longest_asking_(longest_asking),
      listening_(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
  const int on = 1;
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, address, &own.sin_addr);
  socklen_t size = sizeof own;
  auto* const any = reinterpret_cast<sockaddr*>(&own);
  // SO_REUSEADDR alone: with SO_REUSEPORT another process could listen on the same port.
  if (listening_.get() < 0 ||
      setsockopt(listening_.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
      bind(listening_.get(), any, size) != 0 || ::listen(listening_.get(), 64) != 0 ||
      getsockname(listening_.get(), any, &size) != 0) {
    throw base::bad_usage("--port {}: in use or not allowed; choose another, or 0 for any", port);
  }
  port_ = ntohs(own.sin_port);
}

std::string LiveServer::url() const { return fmt::format("http://{}:{}/", address, port_); }

void LiveServer::begin(const std::string& robot, std::string page) {
  if (!robots_.contains(robot) && robots_.size() >= most_robots) return;
  Robot& known = robots_[robot];
  known.first += static_cast<std::int64_t>(known.stretches.size());
  known.stretches.clear();
  bytes_ -= std::exchange(known.bytes, 0);
  known.page = std::make_shared<const std::string>(std::move(page));
}

void LiveServer::add(const std::string& robot, std::string stretch) {
  const auto found = robots_.find(robot);
  if (found == robots_.end()) return;
  Robot& known = found->second;
  std::string event = "data: " + stretch + "\n\n";
  known.bytes += event.size();
  bytes_ += event.size();
  known.stretches.push_back(std::make_shared<const std::string>(std::move(event)));
  while (known.stretches.size() > kept_stretches || bytes_ > kept_bytes) {
    Robot& largest = known.stretches.size() > kept_stretches
                         ? known
                         : std::ranges::max_element(robots_, {}, [](const auto& each) {
                             return each.second.bytes;
                           })->second;
    largest.bytes -= largest.stretches.front()->size();
    bytes_ -= largest.stretches.front()->size();
    largest.stretches.pop_front();
    ++largest.first;
  }
}

void LiveServer::serve(Clock::time_point until) {
  std::vector<pollfd> waiting;
  do {
    waiting.assign(1, {listening_.get(), POLLIN, 0});
    for (const Connection& each : connections_) {
      const bool idle = each.streams && !each.answer;
      waiting.push_back(
          {each.socket.get(), static_cast<short>(each.answering && !idle ? POLLOUT : POLLIN), 0});
    }
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()).count();
    poll(waiting.data(), waiting.size(), static_cast<int>(std::clamp<std::int64_t>(left, 0, 1000)));
    const Clock::time_point now = Clock::now();
    std::erase_if(connections_, [&](Connection& each) { return !advance(each, now); });
    if ((waiting.front().revents & POLLIN) != 0) accept_connections(now);
  } while (Clock::now() < until);
}

void LiveServer::accept_connections(Clock::time_point now) {
  constexpr int most_at_once = 32;
  for (int i = 0; i < most_at_once; ++i) {
    base::FileDescriptor socket(
        accept4(listening_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (socket.get() < 0) return;
    if (connections_.size() >= most_connections) {
      const std::string busy = refusal("503 Service Unavailable");
      [[maybe_unused]] const ssize_t sent =
          send(socket.get(), busy.data(), busy.size(), MSG_NOSIGNAL);
      continue;
    }
    // A browser that does not read holds this much memory of the kernel.
    const int buffer = 65536;
    setsockopt(socket.get(), SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer);
    Connection& connection = connections_.emplace_back();
    connection.socket = std::move(socket);
    connection.deadline = now + longest_asking_;
  }
}

bool LiveServer::advance(Connection& connection, Clock::time_point now) {
  if (!connection.answering) {
    if (!read_request(connection)) return false;
    if (!connection.answering) return now < connection.deadline;
    connection.deadline = now + longest_answering;
  }
  if (connection.streams && !connection.answer && !load_stretch(connection)) {
    std::array<char, 512> ignored;
    const ssize_t got = recv(connection.socket.get(), ignored.data(), ignored.size(), 0);
    connection.deadline = now + longest_answering;
    return got > 0 || (got < 0 && (errno == EAGAIN || errno == EINTR));
  }
  return write_answer(connection, now);
}

bool LiveServer::read_request(Connection& connection) {
  std::array<char, longest_request> buffer;
  const ssize_t got =
      recv(connection.socket.get(), buffer.data(), longest_request - connection.request.size(), 0);
  if (got == 0) return false;
  if (got < 0) return errno == EAGAIN || errno == EINTR;
  connection.request.append(buffer.data(), static_cast<std::size_t>(got));
  const auto end = connection.request.find(end_of_headers);
  if (end != connection.request.npos) {
    connection.request.resize(end + end_of_headers.size());
    answer(connection);
  } else if (connection.request.size() >= longest_request) {
    connection.answering = true;
    connection.answer =
        std::make_shared<const std::string>(refusal("431 Request Header Fields Too Large"));
  }
  return true;
}

void LiveServer::answer(Connection& connection) {
  connection.answering = true;
  const auto refuse = [&](std::string_view status) {
    connection.answer = std::make_shared<const std::string>(refusal(status));
  };
  const std::string text = std::exchange(connection.request, {});
  const std::optional<Request> request = parse(text);
  if (!request) return refuse("400 Bad Request");
  if (request->host != fmt::format("{}:{}", address, port_) &&
      request->host != fmt::format("localhost:{}", port_)) {
    return refuse("403 Forbidden");
  }
  if (request->method != "GET") return refuse("405 Method Not Allowed");
  if (request->has_body) return refuse("413 Content Too Large");
  const std::string robot = robot_in(request->query);
  if (request->path == "/") {
    connection.body = page(robot);
    connection.answer = std::make_shared<const std::string>(
        head("200 OK", "text/html; charset=utf-8", connection.body->size()));
  } else if (request->path != "/events" || !robots_.contains(robot)) {
    refuse("404 Not Found");
  } else if (std::ranges::count_if(connections_, &Connection::streams) >=
             static_cast<std::ptrdiff_t>(most_streams)) {
    refuse("503 Service Unavailable");
  } else {
    connection.streams = true;
    connection.robot = robot;
    connection.answer =
        std::make_shared<const std::string>(head("200 OK", "text/event-stream", {}));
  }
}

bool LiveServer::write_answer(Connection& connection, Clock::time_point now) {
  while (connection.answer) {
    const ssize_t sent = send(connection.socket.get(), connection.answer->data() + connection.sent,
                              connection.answer->size() - connection.sent, MSG_NOSIGNAL);
    if (sent < 0) return (errno == EAGAIN || errno == EINTR) && now < connection.deadline;
    connection.sent += static_cast<std::size_t>(sent);
    if (connection.sent < connection.answer->size()) continue;
    connection.sent = 0;
    connection.answer = std::exchange(connection.body, {});
    if (connection.streams) {
      connection.deadline = now + longest_answering;
      load_stretch(connection);
    }
  }
  if (!connection.streams) discard_input(connection.socket.get());
  return connection.streams;
}

bool LiveServer::load_stretch(Connection& connection) {
  const Robot& robot = robots_.at(connection.robot);
  connection.next = std::max(connection.next, robot.first);
  const auto at = static_cast<std::size_t>(connection.next - robot.first);
  if (at >= robot.stretches.size()) return false;
  connection.answer = robot.stretches[at];
  ++connection.next;
  return true;
}

LiveServer::Text LiveServer::page(const std::string& robot) const {
  if (robots_.empty()) {
    return std::make_shared<const std::string>(waiting_page(
        report::Html("No run yet. This page shows a run within a second after it is heard.")));
  }
  const auto found = robot.empty() && robots_.size() == 1 ? robots_.begin() : robots_.find(robot);
  if (found != robots_.end()) return found->second.page;
  return std::make_shared<const std::string>(waiting_page(
      report::html("Runs of{}", report::each(robots_, [](const auto& each) {
                     return report::html(" <a href=\"/?robot={0}\">{0}</a>", each.first);
                   }))));
}

}  // namespace tachless::live
