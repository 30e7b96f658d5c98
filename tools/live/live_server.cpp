#include "live/live_server.h"

#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/failure.h"
#include "base/this_process.h"
#include "report/html.h"

namespace tachless::live {
namespace {

constexpr const char* address = "127.0.0.1";
constexpr std::size_t kept = 2400;  // a minute of 40 a second
constexpr std::size_t most_browsers = 16;

/// A page without a run, that asks again.
std::string waiting_page(const report::Html& text) {
  return report::
      html("<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><meta http-equiv=\"refresh\" "
           "content=\"1\"><title>tachless</title><p>{}</p></html>\n",
           text)
          .markup();
}

}  // namespace

LiveServer::LiveServer(int port) : server_(std::make_unique<httplib::Server>()) {
  server_->new_task_queue = [] { return new httplib::ThreadPool(most_browsers); };
  // In place of SO_REUSEPORT, the library's default, with which two may listen on one port.
  server_->set_socket_options([](socket_t socket) {
    const int on = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  });
  server_->set_payload_max_length(0);
  server_->set_default_headers({{"Cross-Origin-Resource-Policy", "same-origin"},
                                {"X-Content-Type-Options", "nosniff"},
                                {"X-Frame-Options", "SAMEORIGIN"},
                                {"Cache-Control", "no-store"}});
  server_->set_pre_routing_handler(
      [this](const httplib::Request& request, httplib::Response& response) {
        const std::string host = request.get_header_value("Host");
        const bool own = host == fmt::format("{}:{}", address, port_) ||
                         host == fmt::format("localhost:{}", port_);
        if (own && request.method == "GET") return httplib::Server::HandlerResponse::Unhandled;
        response.status = own ? 405 : 403;
        return httplib::Server::HandlerResponse::Handled;
      });
  server_->Get("/", [this](const httplib::Request& request, httplib::Response& response) {
    response.set_content(page(request.get_param_value("robot")), "text/html; charset=utf-8");
  });
  server_->Get("/events", [this](const httplib::Request& request, httplib::Response& response) {
    response.set_chunked_content_provider(
        "text/event-stream",
        [this, robot = request.get_param_value("robot"), next = std::int64_t(0)](
            std::size_t /*offset*/, httplib::DataSink& sink) mutable {
          const std::string text = events(robot, next);
          if (text.empty()) return false;
          return sink.write(text.data(), text.size());
        });
  });
  port_ = port == 0 ? server_->bind_to_any_port(address)
                    : (server_->bind_to_port(address, port) ? port : -1);
  if (port_ < 0) {
    throw base::bad_usage("--port {}: in use or not allowed; choose another, or 0 for any", port);
  }
  thread_ = std::thread([this] {
    base::leave_signals_to_others();
    server_->listen_after_bind();
    over_ = true;
  });
  // Until then `stop` would be without effect.
  while (!server_->is_running() && !over_) std::this_thread::yield();
}

LiveServer::~LiveServer() {
  over_ = true;
  changed_.notify_all();
  server_->stop();
  thread_.join();
}

std::string LiveServer::url() const { return fmt::format("http://{}:{}/", address, port_); }

void LiveServer::begin(const std::string& robot, std::string page) {
  const std::lock_guard lock(mutex_);
  Robot& known = robots_[robot];
  known.first += static_cast<std::int64_t>(known.stretches.size());
  known.stretches.clear();
  known.page = std::move(page);
}

void LiveServer::add(const std::string& robot, std::string stretch) {
  {
    const std::lock_guard lock(mutex_);
    Robot& known = robots_[robot];
    known.stretches.push_back(std::move(stretch));
    if (known.stretches.size() > kept) {
      known.stretches.pop_front();
      ++known.first;
    }
  }
  changed_.notify_all();
}

std::string LiveServer::page(const std::string& robot) {
  const std::lock_guard lock(mutex_);
  if (robots_.empty()) {
    return waiting_page(
        report::Html("No run yet. A run that goes on already is seen within a second."));
  }
  const auto found = robot.empty() && robots_.size() == 1 ? robots_.begin() : robots_.find(robot);
  if (found != robots_.end()) return found->second.page;
  return waiting_page(report::html("Runs of{}", report::each(robots_, [](const auto& each) {
                                     return report::html(" <a href=\"/?robot={0}\">{0}</a>",
                                                         each.first);
                                   })));
}

std::string LiveServer::events(const std::string& robot, std::int64_t& next) {
  std::unique_lock lock(mutex_);
  const auto found = robots_.find(robot);
  const auto end = [&] {
    return found->second.first + static_cast<std::int64_t>(found->second.stretches.size());
  };
  if (found == robots_.end()) return {};
  changed_.wait_for(lock, std::chrono::seconds(1), [&] { return over_ || end() > next; });
  if (over_) return {};
  std::string text = ":\n\n";  // so that a browser that has gone is noticed
  const auto& [page, stretches, first] = found->second;
  for (next = std::max(next, first); next < end(); ++next) {
    text += "data: " + stretches[static_cast<std::size_t>(next - first)] + "\n\n";
  }
  return text;
}

}  // namespace tachless::live
