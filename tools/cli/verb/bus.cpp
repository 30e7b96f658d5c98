// The verbs that examine this machine and the bus: doctor, watch, spy.

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "base/child.h"
#include "base/clock.h"
#include "base/file_text.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "base/this_process.h"
#include "bus/lcm_url.h"
#include "bus/network_check.h"
#include "bus/udp_transport.h"
#include "certify/prediction.h"
#include "cli/doctor.h"
#include "cli/run.h"
#include "cli/verb.h"
#include "live/bus_monitor.h"
#include "live/page_process.h"
#include "live/watch.h"
#include "session/options.h"
#include "session/statistics.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::Clock;
using base::ExitCode;
using Json = nlohmann::ordered_json;

/// Compares the commands that a run in realtime missed with those that its loop tolerates.
Finding judge_timing(const Json& summary, const certify::Prediction& loop,
                     const std::string& scenario) {
  const auto missed = summary.at("missed_commands").get<std::int64_t>();
  const auto row = summary.at("longest_command_miss").get<std::int64_t>();
  const Json& age = summary.at("command_age_us").at("max");  // null if no command came
  const std::string seen = fmt::format(
      "{} of {} commands missed, at most {} in a row; {}", missed,
      summary.at("ticks").get<std::int64_t>(), row,
      age.is_number()
          ? fmt::format("the slowest came {:g} us after its measurement", age.get<double>())
          : "no command came");
  if (!loop.missed) {
    return {"timing", seen + "; it is not known how many missed commands the loop tolerates"};
  }
  const std::string what = fmt::format("{}; {}", seen, certify::missed_text(*loop.missed));
  if (row <= loop.missed->commands) return {"timing", what};
  return {"timing", what, fmt::format("tachless certify {} --full", scenario)};
}

/// Compares the ticks in which a driver had no reading with the missed ticks that the loop bears.
/// @param command what shows the same run in full
Finding judge_readings(const Json& summary, const certify::Prediction& loop,
                       const std::string& command) {
  const auto missed = summary.at("missed_readings").get<std::int64_t>();
  const auto row = summary.at("longest_reading_miss").get<std::int64_t>();
  const auto ticks = summary.at("ticks").get<std::int64_t>();
  std::string what = fmt::format(
      "{:.4g} % of {} ticks had a reading, at most {} in a row had none",
      ticks > 0 ? 100 - 100.0 * static_cast<double>(missed) / static_cast<double>(ticks) : 0, ticks,
      row);
  const Json& jitter = summary.at("wake_up_jitter_us");
  if (jitter.at("p50").is_number()) {
    what += fmt::format("; wake-up jitter {:g} us (median), {:g} us (99 %)",
                        jitter.at("p50").get<double>(), jitter.at("p99").get<double>());
  }
  for (const auto& [name, value] : summary.at("driver").items()) {
    what += fmt::format("; {} {:.6g}", name, value.get<double>());
  }
  const bool bears = !loop.missed || row <= loop.missed->commands;
  return {"readings", what, bears ? std::nullopt : std::optional(command)};
}

/// Returns the histogram of the times from readings to the torques that answer them.
Finding answers(const Json& summary) {
  std::vector<session::LatencyHistogram::Bucket> buckets;
  std::int64_t count = 0;
  for (const Json& each : summary.at("command_age_us").at("histogram")) {  // null: no command came
    buckets.push_back({each.at(0).get<double>(), each.at(1).get<std::int64_t>()});
    count += buckets.back().count;
  }
  Finding finding{"answers", fmt::format("{} torques, from a reading to its answer", count)};
  finding.bins = bins_of(buckets);
  return finding;
}

struct Doctor {
  std::string lcm_url = session::default_lcm_url;
  fs::path scenario;
  std::string plant;
  double seconds = 60;
  bool zero_torque = false, json = false;

  void declare(CLI::App& command) {
    session::add_lcm_url(command, lcm_url);
    CLI::Option* const given = session::with_installed_scenarios(command.add_option(
        "--scenario", scenario,
        "Run this scenario in realtime, in a private network, and compare the commands it misses "
        "with those that its loop tolerates"));
    CLI::Option* const driver =
        command
            .add_option(
                "--plant", plant,
                "Driver of a real arm, as typed in a shell: the run is then a dry run, which "
                "reads the arm and sends nothing to it")
            ->needs(given);
    command
        .add_flag("--zero-torque", zero_torque,
                  "Start the arm, which has to add gravity, and send it zero torques where the "
                  "scenario begins, in place of a dry run")
        ->needs(driver);
    command.add_option("--seconds", seconds, "Length of that run")
        ->check(CLI::Range(1.0, 3600.0))
        ->capture_default_str()
        ->needs(given);
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    std::vector<Finding> findings = examine(lcm_url, ".");
    if (!scenario.empty()) examine_run(findings);
    Json list = Json::array();
    for (const auto& [subject, what, remedy, warns, bins] : findings) {
      list.push_back({{"subject", subject},
                      {"ok", !remedy},
                      {"warns", warns},
                      {"what", what},
                      {"remedy", remedy ? Json(*remedy) : Json()}});
      for (const Bin& bin : bins) {
        list.back()["histogram"].push_back(
            {{"from_us", bin.from_us}, {"to_us", bin.to_us}, {"count", bin.count}});
      }
      if (json) continue;
      std::cout << fmt::format("{:<5} {:<20}{}\n",
                               remedy  ? "fail"
                               : warns ? "warn"
                                       : "ok",
                               subject, what)
                << text(bins);
      if (remedy) std::cout << "      type: " << *remedy << "\n";
    }
    if (json) std::cout << base::json_text(list, 2) << "\n";
    return std::ranges::all_of(findings, &Finding::ok) ? ExitCode::done : ExitCode::check_said_no;
  }

 private:
  /// Runs the four programs of the scenario on this machine and judges their timing, and the
  /// readings of a driver.
  void examine_run(std::vector<Finding>& findings) const {
    const scenario::Scenario of = scenario::load_scenario(scenario, {});
    const certify::Prediction loop = certify::analyse(of, linear::Effort::full);
    const base::TemporaryDirectory directory;
    RunOptions options;
    options.out = directory.path() / "run";
    options.mode = "realtime";
    options.duration_s = fmt::format("{:g}", seconds);
    options.overrides = {"loop.max_missed_share=1"};  // is judged here
    options.any_outcome = options.quiet = true;
    options.isolate = plant.empty();
    options.plant_program = plant;
    options.dry_run = !plant.empty() && !zero_torque;
    const std::vector<std::string> without_torque = {
        "plant.zero_torque=true", fmt::format("reference={{hold: {{position_rad: [{}]}}}}",
                                              fmt::join(of.plant.initial.position_rad, ", "))};
    if (zero_torque) {
      options.overrides.insert(options.overrides.end(), without_torque.begin(),
                               without_torque.end());
    }
    base::log_info("runs {} in realtime for {:g} s", scenario.string(), seconds);
    const ExitCode code = cli::run(options, {scenario});
    if (code == ExitCode::interrupted) throw base::Failure(code, "doctor: its run was interrupted");
    const std::string file = base::shell_word(scenario.string());
    std::string command = fmt::format("tachless run {} --mode realtime", file);
    if (!plant.empty()) command += fmt::format(" --plant {}", base::shell_word(plant));
    if (options.dry_run) command += " --dry-run";
    for (const std::string& each : zero_torque ? without_torque : std::vector<std::string>()) {
      command += fmt::format(" --set {}", base::shell_word(each));
    }
    if (code != ExitCode::done) {
      findings.push_back({"timing",
                          fmt::format("the run ended with exit code {}", static_cast<int>(code)),
                          command});
      return;
    }
    const Json summary =
        base::parse_json<Json>(base::file_text(options.out / "summary.json").value_or("null"));
    findings.push_back(judge_timing(summary, loop, file));
    findings.push_back(answers(summary));
    if (!plant.empty()) findings.push_back(judge_readings(summary, loop, command));
  }
};

struct Watch {
  bool once = false, json = false, web = false;
  int port = 8011;
  double seconds = 0;  // 0: --once: 2, else until interrupted
  std::string lcm_url = session::default_lcm_url;

  void declare(CLI::App& command) {
    command.add_flag("--once", once, "Listen, print what was received, and end");
    command
        .add_option("--seconds", seconds,
                    "How long to listen [s]; default: --once 2, else until Ctrl-C")
        ->check(CLI::Range(0.01, 1e6));
    command.add_flag("--json", json, "Prints JSON; without --once one line per second");
    auto* const on_page =
        command.add_flag("--web", web, "Shows a page in a browser of this computer: curves, robot");
    on_page->excludes("--once")->excludes("--json");
    command.add_option("--port", port, "Port of the page; 0: any free port")
        ->needs(on_page)
        ->check(CLI::Range(0, 65535))
        ->capture_default_str();
    session::add_lcm_url(command, lcm_url);
  }

  [[nodiscard]] ExitCode run() const {
    const std::atomic<bool>& interrupted = base::catch_interruptions();
    const bus::LcmUrl url = session::parse_lcm_url(lcm_url);
    if (web) return serve(url, interrupted);
    const auto transport = join(url);
    base::set_low_priority();
    transport->subscribe_all();
    live::BusMonitor monitor;
    const auto json_text = [&](int indent) {
      Json result = {{"lcm_url", url.text()}};
      result.update(monitor.to_json());
      return base::json_text(result, indent) + "\n";
    };
    Clock::time_point begin = Clock::now();
    const Clock::time_point end = end_after(begin);
    if (once) {
      live::listen(*transport, monitor, begin, end, interrupted);
      std::cout << (json ? json_text(2)
                         : fmt::format("{}\n{}\n", url.text(), fmt::join(monitor.table(), "\n")));
      return ExitCode::done;
    }
    std::optional<live::TableScreen> screen;
    if (!json) {
      std::cout << url.text() << ", q or Ctrl-C ends\n" << std::flush;
      screen.emplace();
    }
    while (!interrupted && Clock::now() < end && std::cout && !(screen && screen->quit_wanted())) {
      live::listen(*transport, monitor, begin, std::min(end, begin + std::chrono::seconds(1)),
                   interrupted);
      begin = Clock::now();
      if (screen) {
        screen->show(monitor);
      } else {
        std::cout << json_text(-1) << std::flush;
      }
    }
    return ExitCode::done;
  }

 private:
  static std::unique_ptr<bus::UdpTransport> join(const bus::LcmUrl& url) {
    try {
      return std::make_unique<bus::UdpTransport>(url);
    } catch (const std::system_error& error) {
      throw base::bad_usage(error.what());
    }
  }

  /// Serves the runs of all robots on the bus as pages.
  /// @throw base::Failure(check_said_no) if the process that serves them has ended
  [[nodiscard]] ExitCode serve(const bus::LcmUrl& url, const std::atomic<bool>& interrupted) const {
    constexpr std::chrono::milliseconds turn{50};
    live::PageProcess page(url, {}, port);
    std::cout << fmt::format("{} shows the runs on {}; Ctrl-C ends\n", page.url(), url.text())
              << std::flush;
    for (const auto end = end_after(Clock::now()); !interrupted && Clock::now() < end;) {
      if (!page.running()) {
        throw base::Failure(ExitCode::check_said_no,
                            "the live page has ended; type: tachless watch --web");
      }
      std::this_thread::sleep_until(std::min(end, Clock::now() + turn));
    }
    return ExitCode::done;
  }

  [[nodiscard]] Clock::time_point end_after(Clock::time_point begin) const {
    if (seconds == 0 && !once) return Clock::time_point::max();
    return begin + base::nanoseconds_of(seconds == 0 ? 2 : seconds);
  }
};

struct Spy {
  std::string lcm_url = session::default_lcm_url;

  void declare(CLI::App& command) { session::add_lcm_url(command, lcm_url); }

  [[nodiscard]] ExitCode run() const {
    const bus::LcmUrl url = session::parse_lcm_url(lcm_url);
    const char* const display = std::getenv("DISPLAY");
    if (display == nullptr || *display == '\0') {
      refuse(
          "no display: DISPLAY is not set; log in at a desktop or with ssh -X, or use a terminal: "
          "tachless watch");
    }
    if (const auto problem = bus::check_network(url)) {
      refuse(fmt::format("{}; to change this, type: {}", problem->what, problem->remedy));
    }
    // Debian's own lcm-spy passes options that its Java refuses, and does not find the chart
    // library.
    base::become({find_java().string(), "-Djava.net.preferIPv4Stack=true", "-ea", "-cp",
                  class_path(), "lcm.spy.Spy", "-l", url.text()},
                 "as root, type: apt-get install default-jre");
  }

 private:
  [[noreturn]] static void refuse(const std::string& why) { throw base::bad_usage("spy: {}", why); }

  /// Returns the java of the search path, if it can open windows.
  static fs::path find_java() {
    const std::optional<fs::path> java = base::find_program("java");
    if (!java) refuse("there is no java; as root, type: apt-get install default-jre");
    std::error_code error;
    const fs::path home = fs::canonical(*java, error).parent_path().parent_path();
    if (!error && !fs::exists(home / "lib/libawt_xawt.so", error)) {
      refuse(fmt::format(
          "{} is a java without windows (in {}); as root, type: apt-get install default-jre",
          java->string(), home.string()));
    }
    return *java;
  }

  static std::string class_path() {
    const char* const lcm = "/usr/share/java/lcm.jar";
    const char* const charts = "/usr/share/java/jchart2d.jar";
    const fs::path types = base::shared_directory() / "tachless_types.jar";
    for (const auto& [jar, remedy] :
         {std::pair<fs::path, const char*>{lcm, "as root, type: apt-get install liblcm-java"},
          {charts, "as root, type: apt-get install libjchart2d-java"},
          {types, "in a clone, type: ./tachless spy"}}) {
      if (!fs::exists(jar)) refuse(fmt::format("there is no {}; {}", jar.string(), remedy));
    }
    return fmt::format("{}:{}:{}", lcm, charts, types.string());
  }
};

}  // namespace

const Verb doctor_verb = verb_of<Doctor>(
    "doctor", "Checks this machine's setup; prints the command that fixes each problem",
    "  tachless doctor\n"
    "  tachless doctor --json\n"
    "  tachless doctor --scenario scenarios/practical_rigid.yaml --seconds 60\n"
    "  tachless doctor --scenario arm.yaml --plant ./own_driver --seconds 10\n"
    "  tachless doctor --scenario arm.yaml --plant ./own_driver --zero-torque --seconds 10\n"
    "  tachless doctor --lcm-url 'udpm://239.255.76.67:7700?ttl=1'\n"
    "Exit code 0 when there is no problem, 1 otherwise.");

const Verb watch_verb = verb_of<Watch>(
    "watch", "Shows the traffic on the bus: channels, rates, jitter, gaps, newest values",
    "  tachless watch\n"
    "  tachless watch --once --seconds 5\n"
    "  tachless watch --web\n"
    "  tachless watch --once --json --lcm-url 'udpm://239.255.76.67:7700?ttl=0'");

const Verb spy_verb = verb_of<Spy>(
    "spy", "lcm-spy with our message types, in a window; watch is the same in a terminal",
    "  tachless spy\n"
    "  tachless spy --lcm-url 'udpm://239.255.76.67:7700?ttl=0'");

}  // namespace tachless::cli
