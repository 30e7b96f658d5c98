#include "cli/run.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include "base/file_text.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "certify/certify.h"
#include "logger/run_log.h"
#include "lyapunov/law_loop.h"
#include "report/figure.h"
#include "report/recorded_run.h"
#include "report/report.h"
#include "report/report_sections.h"
#include "robot/model.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;

constexpr std::array our_files = {"lcmlog", "summary.json", "tracking.svg", "report.html"};

/// Before the name of a file of an earlier run until this one has begun.
constexpr const char* earlier = ".earlier-";

/// Reads the log, once, into `facts` and `recorded`. @return why it cannot be read, or what is
/// wrong with it if every program ended well; empty: nothing. In realtime ticks may be
/// missing, at the end too, which the logger has reported by then.
std::string read_back(const PlannedRun& run, report::RunFacts& facts,
                      std::optional<report::RecordedRun>& recorded) {
  const scenario::LoopSpec& loop = run.scenario.loop;
  const bool realtime = loop.mode == scenario::Mode::realtime;
  try {
    recorded = report::read_recorded_run(facts.log_path, facts.run_id,
                                         [&](const scenario::Scenario& scenario) {
                                           return certify::no_region(run.predicted).empty()
                                                      ? lyapunov::certified_run(scenario)
                                                      : std::optional<lyapunov::CertifiedRun>();
                                         });
  } catch (const base::Failure& failure) {
    return failure.what();
  }
  facts.log_ticks = static_cast<std::int64_t>(recorded->summary.ticks);
  facts.log_gaps = static_cast<std::int64_t>(recorded->summary.gaps());
  const bool damaged = recorded->damage.any();
  const bool whole = facts.log_ticks == loop.num_ticks && facts.log_gaps == 0;
  if (!damaged && (whole || realtime)) return {};
  return fmt::format(
      "{}: the log was changed after it was written: it has {} of {} ticks and {} gaps{}; run "
      "again, and do not change it before the run has ended",
      facts.log_path, facts.log_ticks, loop.num_ticks, facts.log_gaps,
      damaged ? ", and is damaged" : "");
}

/// Writes the figure and the page, for people: one that fails is one line, and no fault of the run.
template <class Write>
void attempt(const Write& write) {
  try {
    write();
  } catch (const std::exception& failure) {
    base::log_error(failure.what());
  }
}

/// Adds to the log why the run was stopped, as the first of its processes to end tells.
void add_cause(const PlannedRun& run, const fs::path& log, const RunEnd& end) {
  // A check that failed is said after the planned end.
  if (!end.facts.fault || end.code == ExitCode::done || end.code == ExitCode::check_said_no) return;
  logger::ParticipantFault cause;
  cause.text = *end.facts.fault;
  for (const messages::Role role : roles) {
    const std::string name(messages::name(role));
    if (!cause.text.starts_with(name)) continue;
    cause.role = role;
    const std::string told = name + ": ";  // its own words, which the log may have already
    if (cause.text.starts_with(told)) cause.text.erase(0, told.size());
  }
  cause.tick = -1;
  for (const session::Statistics& each : end.statistics) {
    cause.tick = std::max(cause.tick, each.ticks - 1);
  }
  try {
    logger::append_cause(log, run.scenario, run.options.run_id, cause, end.code);
  } catch (const base::Failure& failure) {  // a full disk, say, which has been told
    base::log_detail(failure.what());
  }
}

/// Not decided where the quick search found no weights; nothing: there is no certificate.
std::optional<lyapunov::CertifiedStart> start_of(
    const std::optional<report::RecordedRun>& recorded) {
  if (!recorded || !lyapunov::no_certificate(recorded->scenario).empty()) return {};
  return recorded->certified ? recorded->certified->start : lyapunov::CertifiedStart();
}

/// "this start: certified, needs at most 31 % of a limit", and what is not in it.
std::string start_text(const lyapunov::CertifiedStart& start,
                       const std::vector<std::string>& provisos) {
  if (!start.decided) return "not decided by the quick search of a run; type tachless certify";
  if (!start.certified) return "NOT certified";
  const double share = start.torque_share.value_or(0);
  std::string text = share > 1 ? "certified but for torque limits" : "certified";
  if (share > 0) text += fmt::format(", needs at most {:.0f} % of a limit", 100 * share);
  text += start.proved ? " (continuous time, proved" : " (continuous time, sampled postures";
  for (const std::string& proviso : provisos) text += "; " + proviso;
  return text + ")";
}

/// Returns the law's signals at the end of the log, one number per joint: an adaptive law's
/// estimates are among them.
nlohmann::ordered_json last_signals(const report::RecordedRun& recorded) {
  nlohmann::ordered_json all = nlohmann::ordered_json::object();
  for (const report::LoggedSignal& signal : recorded.signals) {
    all[signal.name] = {{"unit", signal.unit}, {"last", signal.last}};
  }
  return all;
}

/// Writes the files and then, on stdout, the summary.
/// @return the exit code when summary.json cannot be written, after a line that says why
ExitCode write_results(const PlannedRun& run, const RunDirectory& out,
                       const report::RunSummary& summary,
                       std::optional<report::RecordedRun> recorded,
                       const robot::JointLabels& joints) {
  const scenario::Scenario& scenario = summary.scenario;
  nlohmann::ordered_json outcome = to_json(summary, joints);
  if (recorded) outcome["signals"] = last_signals(*recorded);
  std::string start;
  if (const auto certified = start_of(recorded)) {
    outcome["start"] = certify::to_json(*certified);
    const auto& found = recorded->certified;
    const std::string none = certify::no_region(run.predicted);
    start = !none.empty()
                ? "no region is certified: " + none
                : start_text(*certified, found ? found->provisos : std::vector<std::string>());
    start = "  this start: " + start + "\n";
  }
  const std::string json = base::json_text(outcome, 2) + "\n";
  const std::string title =
      fmt::format("{}: {}, h = {}", scenario.name, scenario.controller.law_text(),
                  base::period_text(scenario.loop.period_s));
  const std::string_view remedy = "name another directory with --out";
  const bool moved = summary.tracking.num_ticks() > 0;
  ExitCode code = ExitCode::done;
  try {
    if (out.begun()) base::UnfinishedFile(out / "summary.json", remedy).write(json);
  } catch (const base::Failure& failure) {
    base::log_error(failure.what());
    code = failure.code();
  }
  if (moved && recorded) {
    attempt([&] {
      report::write_figure(
          report::tracking_figure(summary.tracking, title, recorded->end_s(), joints),
          out / "tracking.svg", remedy);
    });
    recorded->outcome = outcome;
    recorded->visuals = run.visuals();
    attempt([&] { report::write_report({*std::move(recorded)}, out / "report.html"); });
  }
  if (run.options.json) {
    std::cout << json;
  } else if (!run.options.quiet && moved) {
    std::cout << fmt::format("\n{}\n\n{}{}\n", run.options.named(title),
                             closing_table(summary, joints), start);
    for (const fs::path& file : out.files()) {
      std::cout << fmt::format("  {}\n", base::printable(file.string()));
    }
  }
  return code;
}

}  // namespace

RunDirectory::RunDirectory(const PlannedRun& run) {
  const RunOptions& options = run.options;
  if (options.out.empty()) {
    runs_ = fs::path("out") / (options.robot.empty() ? run.scenario.name : options.robot);
    make_by_time();
  } else {
    path_ = options.robot.empty() ? options.out : options.out / options.robot;
    make(path_);
  }
  lock_ = base::FileDescriptor(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock_.get() < 0) refuse(fmt::format("cannot be opened: {}", std::strerror(errno)));
  if (flock(lock_.get(), LOCK_EX | LOCK_NB) != 0) refuse("another run is writing there");
  if (access(path_.c_str(), W_OK | X_OK) != 0) refuse("is not writable");
  clear(options.overwrite);
}

RunDirectory::~RunDirectory() {
  look();
  if (begun_) return;
  std::error_code ignored;
  fs::remove(path_ / "lcmlog", ignored);  // empty
  put_back();
  fs::remove(path_, ignored);  // unless it holds other files
}

void RunDirectory::make(const fs::path& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (!error && fs::is_directory(directory)) return;
  path_ = directory;
  refuse("cannot be made a directory" + (error ? ": " + error.message() : ""));
}

void RunDirectory::make_by_time() {
  make(runs_);
  const std::time_t now = std::time(nullptr);
  std::tm time{};
  localtime_r(&now, &time);
  std::error_code error;
  for (int number = 1; number < 1000; ++number) {
    path_ = runs_ / fmt::format("{:%Y-%m-%d-%H%M%S}", time);
    if (number > 1) path_ += fmt::format(".{}", number);
    if (fs::create_directory(path_, error) || error) break;
  }
  if (error) refuse("cannot be made: " + error.message());
}

/// Makes room for the results: those of an earlier run are put aside.
void RunDirectory::clear(bool overwrite) {
  std::error_code error;
  put_back();  // what a run that was killed has put aside
  if (fs::exists(path_ / "latest", error)) refuse("holds the runs of a scenario");
  for (const char* file : our_files) {
    if (fs::is_directory(path_ / file, error)) refuse(fmt::format("{} there is a directory", file));
    if (!overwrite && fs::exists(path_ / file, error)) {
      refuse(fmt::format("the {} of an earlier run is there", file),
             "choose another directory, or replace it with --overwrite");
    }
  }
  for (const fs::path& file : files()) {
    fs::rename(file, path_ / (earlier + file.filename().string()), error);
    if (!error) continue;
    put_back();
    refuse(fmt::format("a file there cannot be replaced: {}", error.message()));
  }
  for (const messages::Role role : roles) fs::remove(statistics_path(role), error);
}

void RunDirectory::put_back() const {
  for (const std::string file : our_files) {
    std::error_code ignored;
    if (fs::exists(path_ / file, ignored)) continue;
    fs::rename(path_ / (earlier + file), path_ / file, ignored);
  }
}

bool RunDirectory::look() {
  if (begun_) return true;
  std::error_code ignored;
  const auto size = fs::file_size(path_ / "lcmlog", ignored);
  if (ignored || size == 0) return false;
  begun_ = true;
  for (const std::string file : our_files) fs::remove(path_ / (earlier + file), ignored);
  if (runs_.empty()) return true;
  const fs::path link = runs_ / fmt::format(".latest-{}", getpid());
  fs::create_symlink(path_.filename(), link, ignored);
  fs::rename(link, runs_ / "latest", ignored);
  return true;
}

fs::path RunDirectory::statistics_path(messages::Role role) const {
  return path_ / fmt::format(".{}.json", messages::name(role));
}

std::vector<session::Statistics> RunDirectory::take_statistics() const {
  std::vector<session::Statistics> all;
  for (const messages::Role role : roles) {
    const fs::path path = statistics_path(role);
    try {
      all.push_back(session::statistics_from_json(base::file_text(path).value_or("")));
    } catch (const std::invalid_argument&) {  // it was killed and left none, or half of it
    }
    std::error_code ignored;
    fs::remove(path, ignored);
  }
  return all;
}

std::vector<fs::path> RunDirectory::files() const {
  std::vector<fs::path> found;
  for (const char* file : our_files) {
    if (fs::exists(path_ / file)) found.push_back(path_ / file);
  }
  return found;
}

void RunDirectory::refuse(const std::string& why, const std::string& remedy) const {
  throw base::bad_usage("--out {}: {}; {}", path_.string(), why, remedy);
}

void Conclusions::add(const PlannedRun& run, RunDirectory& out, RunEnd end) {
  const RunOptions& options = run.options;
  const bool several = !options.robot.empty();
  braces_ = options.json && several;
  if (braces_) std::cout << fmt::format("{}\"{}\": ", count_ == 0 ? "{" : ",", options.robot);
  ++count_;
  out.look();
  const bool done = end.code == ExitCode::done;
  std::optional<report::RecordedRun> recorded;
  end.facts.run_id = options.run_id;
  end.facts.log_path = (out / "lcmlog").string();
  if (out.begun()) add_cause(run, out / "lcmlog", end);
  const std::string problem = read_back(run, end.facts, recorded);
  if (done && !problem.empty()) {
    end.facts.fault = problem;
    end.code = ExitCode::check_said_no;
  }
  if (!out.begun() || !options.leaves_to_verb(end.code)) {
    if (end.facts.fault) base::log_error(options.named(*end.facts.fault));
    for (const std::string& line : end.consequences) base::log_info(line);
  }
  report::RunSummary summary{
      recorded ? recorded->scenario : run.scenario, end.facts,
      recorded ? recorded->tracking : study::Tracking(run.scenario.num_joints), end.statistics};
  summary.predicted = run.predicted;
  if (recorded) {
    summary.verdict = recorded->verdict;
    summary.contacts = recorded->contacts;
  }
  if (end.facts.fault && summary.verdict.outcome != study::Outcome::stopped &&
      (end.code >= ExitCode::peer_lost ||  // perhaps stopped in the last ticks
       summary.ticks() < run.scenario.loop.num_ticks)) {
    summary.verdict.outcome = study::Outcome::stopped;
    summary.verdict.reason = *end.facts.fault;
  }
  const robot::JointLabels joints = robot::joint_labels(*run.scenario.model);
  const ExitCode written = write_results(run, out, summary, std::move(recorded), joints);
  if (end.code == ExitCode::done) end.code = written;
  if (done && !options.any_outcome && bad(summary.verdict.outcome)) {
    base::log_error("{}; --any-outcome makes that no failure",
                    options.named(text(summary.verdict, joints)));
    end.code = ExitCode::check_said_no;
  }
  if (code_ == ExitCode::done) code_ = end.code;
  if (several && !options.json && !options.quiet) {
    const double wall_s = summary.wall_s();
    const auto ticks = static_cast<double>(summary.ticks());
    rows_.push_back({options.robot, std::to_string(summary.ticks()),
                     wall_s > 0 ? report::short_rate(ticks / wall_s) : "-",
                     std::to_string(summary.facts.log_gaps), text(summary.verdict, joints)});
  }
}

ExitCode Conclusions::finish() const {
  if (braces_) std::cout << "}\n";
  if (rows_.empty()) return code_;
  std::vector<std::vector<std::string>> all = {
      {"robot", "ticks", "ticks/s", "log gaps", "verdict"}};
  all.insert(all.end(), rows_.begin(), rows_.end());
  std::cout << "\n" << base::table(all, "lrrrl");
  return code_;
}

}  // namespace tachless::cli
