#include "train/export.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <new>
#include <stdexcept>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "cale/games.h"
#include "policy/onnx/onnx.h"
#include "policy/policy_file.h"
#include "policy/stored_tensors.h"
#include "settings/config.h"
#include "settings/versions.h"
#include "storage/files.h"
#include "storage/manifest.h"
#include "train/agent_file.h"
#include "train/checkpoint.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// Returns the file's contents. Throws std::runtime_error if it is missing or has changed.
std::string from_checkpoint(const fs::path& folder) {
    const auto manifest = read_manifest(folder);
    const auto record = manifest.find(kPolicyFile);
    if (record == manifest.end()) {
        throw std::runtime_error(
            fmt::format("it holds no {}, as those of older versions and of agents without policy(): resume "
                        "the run with its train program, which writes one at its end",
                        kPolicyFile));
    }
    verify(folder, {*record});
    return read_file(folder / kPolicyFile);
}

[[noreturn]] void refuse(const fs::path& path, std::string_view why) {
    throw std::runtime_error(fmt::format("no policy can be made of '{}': {}", path.string(), why));
}

bool is_whole(const fs::path& checkpoint) {
    try {
        static_cast<void>(from_checkpoint(checkpoint));
    } catch (const std::exception&) {
        return false;
    }
    return true;
}

/// Of the newest checkpoint. A score of an older one would pass for one of the run's end, so that is for the
/// user to ask for.
std::string from_run(const fs::path& run_dir) {
    const auto checkpoints = list_checkpoints(run_dir);
    if (checkpoints.empty()) refuse(run_dir, "it has no checkpoint yet");
    const auto newest = checkpoints.rbegin();
    try {
        return from_checkpoint(*newest);
    } catch (const std::exception& error) {
        auto why = fmt::format("its newest checkpoint, {}: {}", newest->filename().string(), error.what());
        const auto older = std::find_if(newest + 1, checkpoints.rend(), is_whole);
        if (older != checkpoints.rend())
            why += fmt::format("; the {} is {}", older == newest + 1 ? "one before" : "newest whole one",
                               older->string());
        refuse(run_dir, why);
    }
}

/// Refuses what does not begin as a policy file before it is read: a device has no end, and another file may
/// be larger than the memory.
std::string read_policy_file(const fs::path& path) {
    const auto no_policy_file = [&](std::string_view why) {
        return std::runtime_error(fmt::format("'{}' is not a policy file: {}", path.string(), why));
    };
    std::error_code error;
    if (fs::exists(path, error) && !fs::is_regular_file(path, error))
        throw no_policy_file("it is no regular file");
    std::ifstream file(path, std::ios::binary);
    std::array<char, sizeof(std::uint64_t)> header{};  // its length
    if (file && (!file.read(header.data(), header.size()) ||
                 !may_be_header(std::bit_cast<std::uint64_t>(header), fs::file_size(path)))) {
        throw no_policy_file(
            "it does not begin with the header of one, or is cut off in it; cale export RUN -o FILE makes "
            "one");
    }
    try {
        return read_file(path);  // which says why, where it cannot be opened
    } catch (const std::bad_alloc&) {
        throw no_policy_file(fmt::format("its {} bytes do not fit into the memory", fs::file_size(path)));
    }
}

}  // namespace

std::string policy_file_of(const fs::path& path) {
    auto where = without_slash(fs::absolute(path));
    if (where.filename() == kAgentFile) where = where.parent_path();
    if (!fs::is_directory(where)) return read_policy_file(path);
    if (!fs::exists(where / kAgentFile)) {
        if (fs::exists(where / "config.yaml")) return from_run(where);
        refuse(path,
               "it is the folder of neither a run nor a checkpoint; give one of these, such as "
               "runs/Pong__sac__1 or its checkpoints/step_000100000, or a policy file");
    }
    try {
        return from_checkpoint(where);
    } catch (const std::exception& error) {
        refuse(path, error.what());
    }
}

Policy policy_of(const fs::path& path, torch::Device device) {
    return Policy::parse(policy_file_of(path), path.string(), device);
}

PolicyInfo export_policy(const fs::path& path, const fs::path& output) {
    const auto contents = policy_file_of(path);
    auto info = Policy::parse(contents, path.string()).info();
    write_file_atomically(output, contents);
    return info;
}

PolicyInfo export_onnx(const fs::path& path, const fs::path& output) {
    const auto contents = policy_file_of(path);
    auto info = Policy::parse(contents, path.string()).info();
    write_file_atomically(output, onnx_model(parse_policy_file(contents)));
    return info;
}

PolicyInfo export_web_page(const fs::path& path, const fs::path& page, const fs::path& folder) {
    if (!fs::exists(page / "cale_module.wasm")) {
        throw std::runtime_error(
            fmt::format("the web page is not built, there is no {}: run scripts/web", page.string()));
    }
    const auto contents = policy_file_of(path);
    auto info = Policy::parse(contents, path.string()).info();
    static_cast<void>(games_of(env_config_of(info).game));
    fs::create_directories(folder);
    for (const auto& file : fs::directory_iterator(page))
        write_file_atomically(folder / file.path().filename(), read_file(file));
    write_file_atomically(folder / "policy.safetensors", contents);
    return info;
}

EnvConfig env_config_of(const PolicyInfo& info) {
    EnvConfig env;
    ConfigTable table;
    table.add("env", env);
    try {
        const auto found = info.provenance.find("config");
        if (found == info.provenance.end()) throw std::runtime_error("it holds none");
        const auto section = YAML::Load(found->second)["env"];
        if (!section.IsMap()) throw std::runtime_error("it has no section env");
        for (const auto& setting : section) {
            const auto key = "env." + setting.first.as<std::string>();
            if (!table.has(key))
                throw std::runtime_error(
                    fmt::format("this version, {}, does not know its setting '{}': use a newer one",
                                cale_version(), key));
            table.at(key).set(setting.second.as<std::string>());
        }
    } catch (const std::exception& error) {
        throw std::runtime_error(
            fmt::format("the configuration that the policy of {} says it was trained with cannot be used: {}",
                        info.game, error.what()));
    }
    return env;
}

}  // namespace cale
