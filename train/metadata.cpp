#include "train/metadata.h"

#include <sys/utsname.h>
#include <unistd.h>

#include <ctime>
#include <fstream>
#include <stdexcept>
#include <string_view>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cale/emulator.h"
#include "settings/command_line.h"
#include "settings/versions.h"
#include "storage/files.h"

namespace cale {
namespace fs = std::filesystem;

struct Metadata::Contents {
    nlohmann::json json = nlohmann::json::object();
};

namespace {

constexpr const char* kFile = "metadata.json";

std::string utc_now() {
    return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
}

std::string host_name() {
    char name[256] = {};
    gethostname(name, sizeof(name) - 1);
    return name;
}

/// "Intel(R) Xeon(R) Platinum 8375C CPU @ 2.90GHz"; the architecture where Linux does not know the model's
/// name.
std::string cpu_model() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);) {
        const auto colon = line.find(": ");
        if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
    }
    utsname system{};
    return uname(&system) == 0 ? system.machine : "unknown";
}

nlohmann::json described(const Session& session) {
    return {{"cale", cale_version()},        {"commit", cale_commit()},
            {"ale", ale_version()},          {"libtorch", torch_version()},
            {"command", session.command},    {"started", utc_now()},
            {"host", host_name()},           {"cpu", cpu_model()},
            {"device", session.device},      {"threads", session.threads},
            {"processes", session.processes}};
}

/// The first key whose value is not what this program writes; none: all are.
std::optional<std::string_view> wrong_key(const nlohmann::json& json) {
    const auto is = [&](const char* key, const auto& condition) {
        const auto found = json.find(key);
        return found == json.end() || condition(*found);
    };
    const auto is_list = [](const auto& value) { return value.is_array(); };
    if (!is("threads", [](const auto& value) {
            return value.is_number_unsigned() && value > 0 && value <= kMostThreads;
        }))
        return "threads";
    if (!is("wall_seconds", [](const auto& value) { return value.is_number() && value >= 0; }))
        return "wall_seconds";
    if (!is("resumed", is_list)) return "resumed";
    if (!is("accepted_changes", is_list)) return "accepted_changes";
    return std::nullopt;
}

}  // namespace

Metadata::Metadata(const fs::path& run_dir)
    : file_(run_dir / kFile), contents_(std::make_unique<Contents>()) {}
Metadata::~Metadata() = default;
Metadata::Metadata(Metadata&&) noexcept = default;
Metadata& Metadata::operator=(Metadata&&) noexcept = default;

Metadata::Metadata(const fs::path& run_dir, const RunIdentity& identity, const Session& session)
    : Metadata(run_dir) {
    std::vector<std::string> roms, md5s;
    for (const auto& rom : identity.roms) {
        roms.push_back(rom.string());
        md5s.push_back(rom_md5(rom));
    }
    auto& json = contents_->json;
    json = described(session);
    json.update({{"program", identity.program},
                 {"exp_name", identity.agent},
                 {"env_id", identity.env_id},
                 {"seed", identity.seed},
                 {"rom", fmt::format("{}", fmt::join(roms, ","))},
                 {"rom_md5", fmt::format("{}", fmt::join(md5s, ","))},
                 {"finished", false},
                 {"stopped", nullptr}});
}

std::optional<Metadata> Metadata::read(const fs::path& run_dir) {
    Metadata metadata(run_dir);
    if (!fs::exists(metadata.file_)) return std::nullopt;
    auto& json = metadata.contents_->json;
    json = nlohmann::json::parse(read_file(metadata.file_), nullptr, /*allow_exceptions=*/false);
    const auto refuse = [&](const std::string& why) {
        throw std::runtime_error(
            fmt::format("{} is damaged: {}; put a copy of it back, or move it away and say --threads with "
                        "the number of threads that the run was started with",
                        metadata.file_.string(), why));
    };
    if (!json.is_object()) refuse("it is no JSON object");
    if (const auto key = wrong_key(json))
        refuse(
            fmt::format("its {} is {}", *key, json[*key].dump(-1, ' ', /*ensure_ascii=*/true).substr(0, 60)));
    metadata.has_this_session_ = false;
    metadata.seconds_before_ = json.value("wall_seconds", 0.0);
    return metadata;
}

std::optional<int> Metadata::threads() const {
    const auto found = contents_->json.find("threads");
    return found == contents_->json.end() ? std::nullopt : std::optional(found->get<int>());
}

std::optional<std::string> Metadata::device() const {
    const auto& json = contents_->json;
    const auto sessions = json.value("resumed", nlohmann::json::array());
    const auto& newest = sessions.empty() ? json : sessions.back();
    if (!newest.is_object() || !newest.contains("device") || !newest["device"].is_string())
        return std::nullopt;
    return newest["device"].get<std::string>();
}

bool Metadata::finished() const {
    const auto found = contents_->json.find("finished");
    return found != contents_->json.end() && *found == true;
}

void Metadata::resume(const Session& session, double trained_seconds) {
    auto& json = contents_->json;
    if (!json.contains("wall_seconds")) seconds_before_ = trained_seconds;
    has_this_session_ = true;
    json["resumed"].push_back(described(session));
    json["finished"] = false;
    json["stopped"] = nullptr;
}

void Metadata::add_change(const std::string& changes) {
    contents_->json["accepted_changes"].push_back(fmt::format("{}: {}", utc_now(), changes));
}

std::string Metadata::newest_change() const {
    const auto changes = contents_->json.value("accepted_changes", nlohmann::json::array());
    if (changes.empty() || !changes.back().is_string()) return "";
    const auto entry = changes.back().get<std::string>();
    const auto time = entry.find(": ");
    return time == std::string::npos ? "" : entry.substr(time + 2);
}

void Metadata::set_schedule_over_run(const std::string& key) {
    contents_->json["schedule_over_run"] = key;
}

void Metadata::finish() {
    contents_->json["finished"] = true;
}

void Metadata::stop(const std::string& why) {
    contents_->json["stopped"] = why;
}

void Metadata::write() {
    const auto elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    contents_->json["wall_seconds"] = seconds_before_ + elapsed;
    // A path need not be UTF-8, as JSON must.
    write_file_atomically(
        file_, contents_->json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

}  // namespace cale
