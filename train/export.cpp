#include "train/export.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <torch/types.h>
#include <torch/utils.h>
#include <yaml-cpp/yaml.h>
#include <nlohmann/json.hpp>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "cale/games.h"
#include "policy/onnx/onnx.h"
#include "policy/policy_file.h"
#include "policy/torch/actor_network.h"
#include "settings/config.h"
#include "settings/run_config.h"
#include "settings/versions.h"
#include "storage/files.h"
#include "storage/manifest.h"
#include "train/agent_file.h"
#include "train/checkpoint.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

using Head = PolicyNetwork::Head;
using Branch = PolicyNetwork::Branch;

// What each agent's settings say of its network and of how it evaluates ------------------

void describe(const NetworkSettings& settings, PolicyNetwork& network) {
    network.encoder = static_cast<PolicyNetwork::Encoder>(settings.encoder);
    network.phi_dqn = static_cast<PolicyNetwork::Rows>(settings.phi_dqn);
    network.hidden_layers = settings.hidden_layers;
    network.hidden_units = settings.hidden_units;
}

double evaluation_epsilon(Exploration exploration, const EpsilonSettings& epsilon) {
    return exploration == Exploration::epsilon_greedy ? epsilon.epsilon_eval : 0;
}

void describe(const SacConfig& config, PolicyFile& policy) {
    describe(config.network, policy.network);
    policy.info.epsilon = evaluation_epsilon(config.exploration, config.epsilon);
}

void describe(const SacdConfig& config, PolicyFile& policy) {
    describe(config.network, policy.network);
    policy.network.head = Head::categorical;
    policy.info.epsilon = evaluation_epsilon(config.exploration, config.epsilon);
}

void describe(const PpoConfig& config, PolicyFile& policy) {
    auto& network = policy.network;
    describe(config.network, network);
    if (config.torso == Torso::shared) {
        network.branch = Branch::shared;
        network.padding = PolicyNetwork::Padding::valid;
    }
    network.activation = PolicyNetwork::Activation::tanh;
    network.head = network.num_actions == 0 ? Head::gaussian : Head::categorical;
    policy.info.evaluation_samples = true;
    policy.info.epsilon = evaluation_epsilon(config.exploration, config.epsilon);
}

/// DQN and DER.
void describe_values(const auto& config, PolicyFile& policy) {
    auto& network = policy.network;
    network.encoder = static_cast<PolicyNetwork::Encoder>(config.encoder);
    network.padding = static_cast<PolicyNetwork::Padding>(config.padding);
    network.branch = Branch::none;
    network.hidden_units = config.hidden_units;
    network.head = Head::values;
    network.dueling = config.dueling;
    policy.info.epsilon = config.epsilon.epsilon_eval;
}

void describe(const DqnConfig& config, PolicyFile& policy) {
    describe_values(config, policy);
}

void describe(const DerConfig& config, PolicyFile& policy) {
    describe_values(config, policy);
    policy.network.num_atoms = config.distributional ? config.num_atoms : 1;
    policy.network.value_limit = config.value_limit;
}

void describe(const EnvConfig& env, PolicyFile& policy) {
    auto& [info, network, weights, golden] = policy;
    info.game = find_game(env.game).name;
    info.action_space = names_of(ActionSet{})[static_cast<std::size_t>(env.action_space)];
    if (env.action_space != ActionSet::continuous) {
        auto any_machine = env;
        if (!fs::is_directory(env.rom_dir)) any_machine.rom_dir.clear();
        const Env game(any_machine, /*seed=*/0);
        info.actions.assign(game.actions().begin(), game.actions().end());
    }
    network.num_actions = info.num_actions();
    info.threshold = env.threshold;
    info.event_map = env.event_map;
    info.radius_is_strength = env.paddle_strength == PaddleStrength::radius;
    info.frame_skip = env.frame_skip;
    info.life_loss_ends_episode = env.terminal_on_life_loss;
}

/// All that a run's configuration says.
template <class AgentConfig>
PolicyFile described(const fs::path& config_file) {
    RunConfig<AgentConfig> config;
    auto table = settings_of(config);
    table.load(config_file);
    PolicyFile policy;
    describe(config.env, policy);
    describe(config.agent, policy);
    policy.info.encoder = table.at("agent.encoder").get();
    policy.info.provenance["seed"] = std::to_string(config.train.seed);
    return policy;
}

struct KnownAgent {
    std::string_view name;
    PolicyFile (*described)(const fs::path& config_file);
};
constexpr KnownAgent kAgents[] = {{"sac", described<SacConfig>},
                                  {"sacd", described<SacdConfig>},
                                  {"ppo", described<PpoConfig>},
                                  {"dqn", described<DqnConfig>},
                                  {"der", described<DerConfig>}};

PolicyFile described(const std::string& agent, const fs::path& config_file) {
    std::string known;
    for (const auto& [name, function] : kAgents) {
        if (name == agent) {
            auto policy = function(config_file);
            policy.info.agent = agent;
            return policy;
        }
        known += fmt::format("{}{}", known.empty() ? "" : ", ", name);
    }
    throw std::runtime_error(fmt::format("its agent is '{}': policies can be made of {}", agent, known));
}

/// A run's configuration without comments and without the folder of somebody's ROMs.
std::string without_comments(const std::string& yaml) {
    std::istringstream lines(yaml);
    std::string result;
    for (std::string line; std::getline(lines, line);) {
        const auto text = std::string_view(line).substr(std::min(line.find_first_not_of(' '), line.size()));
        if (!text.empty() && text.front() != '#' && !text.starts_with("rom_dir:")) result += line + "\n";
    }
    return result;
}

// Weights -----------------------------------------------------------------------------

/// A parameter of a policy among those of its agent.
torch::Tensor parameter_of(const TensorMap& state, const std::string& name) {
    const auto find = [&](const std::string& key) {
        const auto found = state.find("network/" + key);
        return found == state.end() ? torch::Tensor() : found->second;
    };
    if (auto tensor = find(name); tensor.defined()) return tensor;
    // Noisy layers act by their means in evaluation.
    if (auto mean = find(name + "_mu"); mean.defined()) return mean;
    // PPO's log standard deviations as released are a sum (LogStd::summed).
    const auto weight = find(name + ".weight"), bias = find(name + ".bias");
    if (weight.defined() && bias.defined()) return weight.sum(1) + bias;
    throw std::runtime_error(fmt::format("its agent has no '{}'", name));
}

void take_weights(const TensorMap& state, PolicyFile& policy) {
    for (const auto& [name, type, shape] : parameters_of(policy.network)) {
        const auto tensor = parameter_of(state, name).contiguous();
        if (tensor.scalar_type() != torch::kFloat32 || tensor.sizes() != at::IntArrayRef(shape)) {
            throw std::runtime_error(fmt::format("its '{}' is not of the shape that config.yaml asks for: {}",
                                                 name, text_of_shape(shape)));
        }
        const float* const numbers = tensor.const_data_ptr<float>();
        policy.weights[name].assign(numbers, numbers + tensor.numel());
    }
}

void make_golden(PolicyFile& policy) {
    const torch::NoGradGuard no_grad;
    auto& [info, network, weights, golden] = policy;
    golden.observation = golden_observation(info);
    const auto observation = torch::tensor(at::ArrayRef<std::uint8_t>(golden.observation), torch::kUInt8)
                                 .view({1, network.stack, network.frame_height, network.frame_width});
    const auto output = ActorNetwork(network, weights, torch::kCPU).output(observation).contiguous();
    const float* const numbers = output.const_data_ptr<float>();
    golden.output.assign(numbers, numbers + output.numel());
}

/// Throws std::runtime_error where the two files that are needed are not what was written.
void verify_parts(const fs::path& folder) {
    const auto manifest = read_manifest(folder);
    for (const auto& name : {kAgentFile, "state.json"}) {
        const auto record = manifest.find(name);
        if (record == manifest.end()) throw std::runtime_error(fmt::format("it lacks {}", name));
        verify(folder, {*record});
    }
}

std::string from_checkpoint(const fs::path& folder) {
    verify_parts(folder);
    const auto run_dir = folder.parent_path().parent_path();
    const auto metadata = nlohmann::json::parse(read_file(run_dir / "metadata.json"), nullptr, false);
    if (!metadata.is_object() || !metadata.contains("exp_name") || !metadata["exp_name"].is_string())
        throw std::runtime_error(fmt::format(
            "{} is damaged: it names no agent; put a copy of it back, or write \"exp_name\": \"sac\", or "
            "whichever it is, into it",
            (run_dir / "metadata.json").string()));
    const auto state = nlohmann::json::parse(read_file(folder / "state.json"));
    auto policy = described(metadata.at("exp_name").get<std::string>(), run_dir / "config.yaml");
    auto& origin = policy.info.provenance;
    origin["agent_steps"] = std::to_string(state.at("step").get<std::int64_t>());
    origin["frames"] = std::to_string(state.at("frame").get<std::int64_t>());
    for (const auto* name : {"cale", "ale", "libtorch"}) origin[name] = metadata.value(name, "");
    origin["config"] = without_comments(read_file(run_dir / "config.yaml"));
    take_weights(load_agent(folder), policy);
    make_golden(policy);
    return policy_file_contents(policy);
}

[[noreturn]] void refuse(const fs::path& path, std::string_view why) {
    throw std::runtime_error(fmt::format("no policy can be made of '{}': {}", path.string(), why));
}

std::string from_run(const fs::path& run_dir) {
    const auto checkpoints = list_checkpoints(run_dir);
    if (checkpoints.empty()) refuse(run_dir, "it has no checkpoint yet");
    std::string why;
    for (auto folder = checkpoints.rbegin(); folder != checkpoints.rend(); ++folder) {
        try {
            return from_checkpoint(*folder);
        } catch (const std::exception& error) {
            if (why.empty()) why = error.what();  // of the newest
        }
    }
    refuse(run_dir, why);
}

/// Refuses what does not begin as a policy file before it is read: a device has no end, and another file may
/// be larger than the memory.
std::string read_policy_file(const fs::path& path) {
    const auto refuse_file = [&](std::string_view why) {
        throw std::runtime_error(fmt::format("'{}' is not a policy file: {}", path.string(), why));
    };
    std::error_code error;
    if (fs::exists(path, error) && !fs::is_regular_file(path, error)) refuse_file("it is no regular file");
    std::ifstream file(path, std::ios::binary);
    std::array<char, sizeof(std::uint64_t)> header{};  // its length
    if (file && (!file.read(header.data(), header.size()) ||
                 std::bit_cast<std::uint64_t>(header) > fs::file_size(path) - header.size())) {
        refuse_file(
            "it does not begin with the header of one, or is cut off in it; cale export RUN -o FILE makes "
            "one");
    }
    return read_file(path);  // which says why, where it cannot be opened
}

}  // namespace

std::string policy_file_of(const fs::path& path) {
    auto where = fs::absolute(path).lexically_normal();
    if (!where.has_filename()) where = where.parent_path();  // a slash at the end
    if (where.filename() == kAgentFile) where = where.parent_path();
    if (!fs::is_directory(where)) return read_policy_file(path);
    if (!fs::exists(where / kAgentFile)) {
        if (fs::exists(where / "config.yaml")) return from_run(where);
        refuse(path, "it is the folder of neither a run nor a checkpoint");
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

EnvConfig env_config_of(const PolicyInfo& info) {
    EnvConfig env;
    ConfigTable table;
    table.add("env", env);
    try {
        const auto found = info.provenance.find("config");
        if (found == info.provenance.end()) throw std::runtime_error("it holds none");
        const auto config = YAML::Load(found->second);
        for (const auto& setting : config["env"])
            table.at("env." + setting.first.as<std::string>()).set(setting.second.as<std::string>());
    } catch (const std::exception& error) {
        throw std::runtime_error(
            fmt::format("the configuration that the policy of {} says it was trained with cannot be used: {}",
                        info.game, error.what()));
    }
    return env;
}

}  // namespace cale
