// What the real TensorBoard, installed by scripts/setup --with-tests, makes of a run's folder.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace test {

/// Returns what tests/train/read_events.py prints. Throws std::runtime_error without a TensorBoard, and where
/// it cannot read the events.
inline nlohmann::json read_by_tensorboard(const std::filesystem::path& folder) {
    const char* dependencies = std::getenv("CALE_DEPS_DIR");
    const std::filesystem::path tools =
        std::filesystem::path(dependencies != nullptr ? dependencies : CALE_DEPS_DIR) / "test-tools";
    if (!std::filesystem::exists(tools / "tensorboard")) {
        throw std::runtime_error("no TensorBoard in " + tools.string() + ": run scripts/setup --with-tests");
    }
    const auto command = "PYTHONPATH='" + tools.string() + "' /usr/bin/python3 '" CALE_READ_EVENTS "' '" +
                         folder.string() + "' 2>'" + (folder / "stderr").string() + "'";
    std::FILE* pipe = ::popen(command.c_str(), "r");
    std::string output;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) output.push_back(static_cast<char>(c));
    if (::pclose(pipe) != 0) throw std::runtime_error("TensorBoard could not read the events: " + command);
    return nlohmann::json::parse(output);
}

}  // namespace test
