// Folders like those that training leaves behind.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "support/temporary_folder.h"

namespace cale::test {

class RunFolders {
  public:
    explicit RunFolders(const std::string& name)
        : path_(std::filesystem::canonical(temporary_.path()) / name) {
        std::filesystem::create_directory(path_);
    }

    const std::filesystem::path& path() const { return path_; }

    std::filesystem::path write(const std::filesystem::path& name, const std::string& text) const {
        std::filesystem::create_directories((path_ / name).parent_path());
        std::ofstream(path_ / name) << text;
        return path_ / name;
    }

    /// A run whose games end every 100 agent steps. `settings`: a config.yaml's.
    std::filesystem::path run(const std::string& folder, const std::string& agent, const std::string& game,
                              std::uint64_t seed, const std::vector<double>& returns,
                              const std::string& settings = "agent: {encoder: phi_sac}\n") const {
        std::string episodes = fmt::format(
            "#{{\"t_start\":0.0,\"env_id\":\"ALE/{}-v5\",\"agent\":\"{}\",\"seed\":{}}}\n"
            "r,l,t,global_step,frame,seed,env,truncated\n",
            game, agent, seed);
        for (std::size_t i = 0; i < returns.size(); ++i)
            episodes +=
                fmt::format("{},100,1.5,{},{},{},0,0\n", returns[i], 100 * (i + 1), 400 * (i + 1), seed);
        write(folder + "/episodes.csv", episodes);
        write(folder + "/config.yaml", settings);
        return path_ / folder;
    }

  private:
    const ::test::TemporaryFolder temporary_;
    std::filesystem::path path_;
};

}  // namespace cale::test
