// Policies made of checkpoints, held to the agents that they are of.
#include "train/export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>

#include <torch/types.h>
#include <nlohmann/json.hpp>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/random.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "cale/env.h"
#include "cale/text.h"
#include "policy/network_parameters.h"
#include "policy/policy_file.h"
#include "policy/policy_lite.h"
#include "settings/config.h"
#include "settings/run_config.h"
#include "storage/files.h"
#include "support/temporary_folder.h"
#include "train/checkpoint.h"
#include "train/policy_snapshot.h"
#include "train/safetensors.h"
#include "train/training.h"
#include "train/training_world.h"
#include "web/settings.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// An agent that has not learned yet, and the run that it is of.
struct Case {
    std::string name, agent;
    std::function<std::unique_ptr<Agent>(const AgentSpec&)> make;
    std::function<std::string()> config_yaml;
    EnvConfig env;
};

template <class AgentConfig>
Case make_case(const std::string& name, const std::string& agent, AgentConfig agent_config,
               ActionSet action_space, std::unique_ptr<Agent> (*make)(const AgentConfig&, const AgentSpec&),
               Obs obs = Obs::pixels, Joystick coordinates = Joystick::polar) {
    if constexpr (requires { agent_config.replay; }) agent_config.replay.replay_capacity = 1'000;
    auto env = protocol_atari100k("breakout");
    env.action_space = action_space;
    env.threshold = 0.25;
    env.obs = obs;
    env.joystick = coordinates;
    if (name == "sac_ram") {  // what else a policy must know of its world
        env.event_map = EventMap::ale_0_10;
        env.paddle_strength = PaddleStrength::radius;
        env.frame_skip = 2;
    }
    const auto yaml = [agent_config, env] {
        RunConfig<AgentConfig> config;
        auto table = settings_of(config);
        config.env = env;
        config.env.rom_dir = "/somebody/roms";
        config.agent = agent_config;
        return table.to_yaml();
    };
    return {name, agent, [agent_config, make](const AgentSpec& spec) { return make(agent_config, spec); },
            yaml, env};
}

std::vector<Case> cases() {
    SacConfig sac, sac_impala;
    sac_impala.network.encoder = EncoderKind::impala;
    sac_impala.exploration = Exploration::epsilon_greedy;
    sac_impala.epsilon.epsilon_eval = 0.5;
    SacConfig sac_sampled = sac_impala;
    sac_sampled.sampled_evaluation = true;
    SacdConfig sacd;
    sacd.network.encoder = EncoderKind::impala;
    SacdConfig sacd_sampled = sacd;
    sacd_sampled.sampled_evaluation = true;
    PpoConfig ppo, ppo_shared;
    ppo.network.encoder = EncoderKind::impala;
    ppo_shared.network.encoder = EncoderKind::phi_dqn;
    ppo_shared.torso = Torso::shared;
    ppo_shared.log_std = LogStd::direct;
    DqnConfig dqn, nature;
    dqn.epsilon.epsilon_eval = 0.5;
    nature.padding = Padding::valid;
    DerConfig der;
    der.encoder = EncoderKind::impala;
    DerConfig rainbow_parts = der;
    rainbow_parts.distributional = rainbow_parts.noisy = false;
    DerConfig der_noisy = der;
    der_noisy.noisy_evaluation = true;
    der_noisy.noisy_sigma = 2;
    DerConfig der_noisy_factored = der_noisy;
    der_noisy_factored.epsilon.epsilon_eval = 0;
    der_noisy_factored.encoder = EncoderKind::mlp;
    der_noisy_factored.layer_norm = true;
    der_noisy_factored.dueling = der_noisy_factored.distributional = false;
    SacConfig sac_ram;
    PpoConfig ppo_ram;
    DqnConfig dqn_ram;
    sac_ram.network.encoder = ppo_ram.network.encoder = dqn_ram.encoder = EncoderKind::mlp;
    // No draw for an epsilon of 0, so that the next evaluation's draws are the same.
    SacConfig sac_without_epsilon = sac_ram;
    SacdConfig sacd_standard;
    PpoConfig ppo_without_epsilon = ppo_ram;
    sacd_standard.network.encoder = EncoderKind::mlp;
    sac_without_epsilon.exploration = ppo_without_epsilon.exploration = Exploration::epsilon_greedy;
    sac_without_epsilon.epsilon.epsilon_eval = ppo_without_epsilon.epsilon.epsilon_eval = 0;
    PpoConfig ppo_epsilon = ppo_without_epsilon;
    ppo_epsilon.epsilon.epsilon_eval = 0.5;
    sacd_standard.exploration = Exploration::standard;
    sac_without_epsilon.sampled_evaluation = sacd_standard.sampled_evaluation = true;
    const auto joystick = ActionSet::continuous;
    return {
        make_case("sac", "sac", sac, joystick, make_sac),
        make_case("sac_impala", "sac", sac_impala, joystick, make_sac),
        make_case("sac_sampled", "sac", sac_sampled, joystick, make_sac),
        make_case("sacd", "sacd", sacd, ActionSet::full, make_sacd),
        make_case("sacd_sampled", "sacd", sacd_sampled, ActionSet::full, make_sacd),
        make_case("ppo", "ppo", ppo, joystick, make_ppo),
        make_case("ppo_shared", "ppo", ppo_shared, joystick, make_ppo),
        make_case("ppo_discrete", "ppo", ppo, ActionSet::minimal, make_ppo),
        make_case("dqn", "dqn", dqn, ActionSet::minimal, make_dqn),
        make_case("nature", "dqn", nature, ActionSet::minimal, make_dqn),
        make_case("der", "der", der, ActionSet::minimal, make_der),
        make_case("der_parts", "der", rainbow_parts, ActionSet::minimal, make_der),
        make_case("sac_ram", "sac", sac_ram, joystick, make_sac, Obs::ram),
        make_case("ppo_ram", "ppo", ppo_ram, joystick, make_ppo, Obs::ram),
        make_case("dqn_ram", "dqn", dqn_ram, ActionSet::minimal, make_dqn, Obs::ram),
        make_case("sac_without_epsilon_sampled", "sac", sac_without_epsilon, joystick, make_sac, Obs::ram),
        make_case("sacd_standard_sampled", "sacd", sacd_standard, ActionSet::full, make_sacd, Obs::ram),
        make_case("ppo_without_epsilon", "ppo", ppo_without_epsilon, joystick, make_ppo, Obs::ram),
        make_case("ppo_epsilon", "ppo", ppo_epsilon, joystick, make_ppo, Obs::ram),
        make_case("sac_cartesian", "sac", sac_ram, joystick, make_sac, Obs::ram, Joystick::cartesian),
        make_case("ppo_direction", "ppo", ppo_ram, joystick, make_ppo, Obs::ram, Joystick::direction),
        make_case("sacd_factored", "sacd", sacd, joystick, make_sacd, Obs::pixels, Joystick::factored),
        make_case("der_factored", "der", der, joystick, make_der, Obs::pixels, Joystick::factored),
        make_case("der_noisy", "der", der_noisy, ActionSet::minimal, make_der),
        make_case("der_noisy_factored", "der", der_noisy_factored, joystick, make_der, Obs::ram,
                  Joystick::factored)};
}

/// What is seen of a game of Breakout that chance plays: [count, stack, ...].
torch::Tensor game_observations(EnvConfig config, std::int64_t count) {
    config.action_space = ActionSet::continuous;
    config.joystick = Joystick::polar;
    Env env(config, 3);
    const auto space = observation_space(config);
    FrameStack stack(1, static_cast<std::size_t>(space.stack), static_cast<std::size_t>(space.frame_size()));
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(space.frame_size()));
    env.reset(frame);
    auto observations = torch::empty(space.tensor_shape({count}), torch::kUInt8);
    StepResult result;
    for (std::int64_t i = 0; i < count; ++i) {
        stack.push(0, frame);
        std::ranges::copy(stack.data(), observations[i].data_ptr<std::uint8_t>());
        if (result.episode_over) env.reset(frame);
        const float theta = static_cast<float>(i % 7) - 3;
        result = env.step(ContinuousAction{1, theta, i % 5 == 0 ? 1.0f : 0.0f}, frame);
    }
    return observations;
}

class ExportEmulator : public testing::TestWithParam<Case> {
  protected:
    ExportEmulator() {
        const auto& [name, agent_name, make, config_yaml, env] = GetParam();
        const auto yaml = config_yaml();
        write_file_atomically(run / "config.yaml", yaml);
        const auto world = training_world(env, {});
        const std::uint32_t seed = 0;
        const auto one = world.make({&seed, 1});
        AgentSpec spec;
        spec.action_space = one->action_space();
        spec.observation = one->observation_space();
        agent = make(spec);
        RunSnapshot snapshot;
        snapshot.state.step = 1'234;
        snapshot.state.frame = 4'936;
        snapshot.agent = agent->state();
        TrainOptions options;
        options.agent_name = agent_name;
        options.config = yaml;
        options.hyperparameters = {{"agent.encoder", "its encoder"}};
        snapshot.policy = {*agent->policy(), *run_policy_info(world, {}, options)};
        snapshot.policy->info.provenance["agent_steps"] = "1234";
        evaluation_random = restored_generator(snapshot.agent.at("random/evaluation"));
        checkpoint = write_checkpoint(run, std::move(snapshot), nullptr, nullptr).folder;
    }

    test::TemporaryFolder folder;
    fs::path run = folder.path();
    fs::path checkpoint;
    std::unique_ptr<Agent> agent;
    at::Generator evaluation_random;
};

TEST_P(ExportEmulator, ActsAsTheAgentEvaluates) {
    const auto policy = policy_of(run);
    const auto lite = lite::Policy::parse(policy_file_of(checkpoint));
    auto workspace = lite.workspace();
    const auto frames = game_observations(GetParam().env, 24);
    const auto greedy = policy.act(frames).contiguous();
    // Twice: the second time shows whether both drew as much in the first.
    for (int time = 0; time < 2; ++time) {
        const auto expected = agent->act(frames, ActMode::evaluate);
        EXPECT_TRUE(at::equal(policy.act(frames, Choice::as_evaluated, evaluation_random), expected));
        EXPECT_TRUE(!policy.info().evaluation_samples || !at::equal(expected, greedy));
    }
    for (std::int64_t i = 0; i < frames.size(0); ++i) {
        const std::span pixels(frames[i].const_data_ptr<std::uint8_t>(), policy.info().observation_size());
        const auto decision = lite.act(pixels, workspace);
        if (policy.info().actions.empty()) {
            const auto chosen = chosen_stick(GetParam().env.joystick, greedy, i);
            EXPECT_NEAR(decision.stick.radius, chosen.radius, 1e-5);
            EXPECT_NEAR(decision.stick.theta, chosen.theta, 1e-4);
            EXPECT_NEAR(decision.stick.fire, chosen.fire, 1e-5);
        } else {
            EXPECT_EQ(decision.action, greedy[i].item<std::int64_t>());
        }
    }

    const auto& info = policy.info();
    EXPECT_EQ(info.game, "Breakout");
    EXPECT_EQ(info.agent, GetParam().agent);
    EXPECT_EQ(info.encoder, "its encoder");
    EXPECT_EQ(info.threshold, 0.25);
    EXPECT_TRUE(info.life_loss_ends_episode);
    EXPECT_EQ(info.evaluation_samples, GetParam().agent == "ppo" ||
                                           GetParam().name.starts_with("der_noisy") ||
                                           GetParam().name.ends_with("_sampled"));
    EXPECT_EQ(info.provenance.at("agent_steps"), "1234");
    EXPECT_EQ(info.provenance.at("seed"), "1");
    auto env = env_config_of(info);
    EXPECT_EQ(env.game, "breakout");
    EXPECT_EQ(env.threshold, 0.25);
    EXPECT_EQ(env.event_map, GetParam().env.event_map);
    EXPECT_EQ(env.paddle_strength, GetParam().env.paddle_strength);
    EXPECT_EQ(env.frame_skip, GetParam().env.frame_skip);
    EXPECT_EQ(env.action_space, GetParam().env.action_space);
    EXPECT_EQ(env.joystick, GetParam().env.joystick);
    EXPECT_TRUE(env.rom_dir.empty());
    EXPECT_EQ(info.provenance.at("config").find("somebody"), std::string::npos);
    // The web page reads the same without a library for YAML.
    const auto in_page = web::trained_env(info);
    fields(env, [&](std::string_view name, const auto&...) {
        EXPECT_EQ(web::setting(in_page, name), web::setting(env, name)) << name;
    });
}

/// What real Python packages, installed by scripts/setup --with-tests, make of the files.
nlohmann::json read_by_python(const fs::path& policy, const fs::path& model, const fs::path& observations) {
    const char* dependencies = std::getenv("CALE_DEPS_DIR");
    const fs::path tools = fs::path(dependencies != nullptr ? dependencies : CALE_DEPS_DIR) / "test-tools";
    for (const auto* package : {"safetensors", "onnxruntime"}) {
        if (!fs::exists(tools / package))
            throw std::runtime_error("no " + (tools / package).string() + ": run scripts/setup --with-tests");
    }
    const auto command = "PYTHONPATH='" + tools.string() + "' /usr/bin/python3 '" CALE_READ_POLICY "' '" +
                         policy.string() + "' '" + model.string() + "' '" + observations.string() + "'";
    std::FILE* pipe = ::popen(command.c_str(), "r");
    std::string output;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) output.push_back(static_cast<char>(c));
    if (::pclose(pipe) != 0) throw std::runtime_error("Python could not read the files: " + command);
    return nlohmann::json::parse(output);
}

TEST_P(ExportEmulator, IsReadByPythonAndByOnnxRuntime) {
    export_policy(checkpoint / "agent.safetensors.zst", folder / "policy.safetensors");
    export_onnx(folder / "policy.safetensors", folder / "policy.onnx");
    const auto policy = Policy::load(folder / "policy.safetensors");
    const auto frames = game_observations(GetParam().env, 16);
    const std::string_view pixels(reinterpret_cast<const char*>(frames.const_data_ptr()), frames.nbytes());
    write_file_atomically(folder / "observations", pixels);
    const auto read =
        read_by_python(folder / "policy.safetensors", folder / "policy.onnx", folder / "observations");

    const auto file = parse_policy_file(read_file(folder / "policy.safetensors"));
    EXPECT_EQ(read["tensors"].size(), file.weights.size() + 2);
    for (const auto& [name, shape] : parameter_shapes(file.network)) {
        EXPECT_EQ(read["tensors"][name], (nlohmann::json{"float32", shape})) << name;
        double sum = 0;
        for (const float number : file.weights.at(name)) sum += static_cast<double>(number);
        EXPECT_NEAR(read["sums"][name].get<double>(), sum, 1e-6 * (1 + std::abs(sum))) << name;
    }
    for (const auto& [key, text] : policy_file_texts(file)) {
        EXPECT_EQ(read["metadata"][key], text) << key;
        EXPECT_EQ(read["model"][key], text) << key;
    }
    const auto outputs = policy.output(frames), actions = policy.act(frames);
    for (std::int64_t i = 0; i < frames.size(0); ++i) {
        const auto row = read["output"][static_cast<std::size_t>(i)].get<std::vector<float>>();
        EXPECT_TRUE(at::allclose(outputs[i], torch::tensor(row), 1e-4, 1e-4))
            << outputs[i] << torch::tensor(row);
        const auto& action = read["action"][static_cast<std::size_t>(i)];
        if (policy.info().actions.empty()) {
            EXPECT_TRUE(
                at::allclose(actions[i], torch::tensor(action.get<std::vector<float>>()), 1e-4, 1e-4));
        } else {
            EXPECT_EQ(actions[i].item<std::int64_t>(), action.get<std::int64_t>());
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Agents, ExportEmulator, testing::ValuesIn(cases()),
                         [](const auto& chosen) { return chosen.param.name; });

class ExportRefusesEmulator : public ExportEmulator {
  protected:
    std::string error() const {
        return test::error_of<std::runtime_error>([&] { policy_file_of(run); });
    }
};
INSTANTIATE_TEST_SUITE_P(One, ExportRefusesEmulator, testing::Values(cases()[3]));

TEST_P(ExportRefusesEmulator, AWebPageThatIsNotBuilt) {
    const auto page = folder / "page", site = folder / "sites" / "one";
    const auto write = [&] { return export_web_page(run, page, site); };
    EXPECT_EQ(test::error_of<std::runtime_error>(write),
              "the web page is not built, there is no " + page.string() + ": run scripts/web");
    EXPECT_FALSE(fs::exists(site));
    fs::create_directories(page);
    write_file_atomically(page / "index.html", "<!DOCTYPE html>");
    write_file_atomically(page / "cale_module.wasm", "asm");
    for (int time = 0; time < 2; ++time) {  // the second time over what is there
        EXPECT_EQ(write().game, "Breakout");
        EXPECT_EQ(read_file(site / "index.html"), "<!DOCTYPE html>");
        EXPECT_EQ(read_file(site / "cale_module.wasm"), "asm");
        EXPECT_EQ(read_file(site / "policy.safetensors"), policy_file_of(run));
    }
}

TEST_P(ExportRefusesEmulator, WhatIsNoPolicy) {
    const auto prefix = "no policy can be made of '" + run.string() + "': ";
    const auto whole = read_file(checkpoint / kPolicyFile);
    auto bytes = whole;
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    write_file_atomically(checkpoint / kPolicyFile, bytes);
    EXPECT_THAT(error(), HasSubstr(prefix));
    EXPECT_THAT(error(), HasSubstr(kPolicyFile));
    write_file_atomically(checkpoint / kPolicyFile, whole);
    EXPECT_EQ(error(), "no error");

    // As older versions wrote it.
    RunSnapshot snapshot;
    snapshot.state.step = 2'345;
    snapshot.agent = agent->state();
    const auto newest = write_checkpoint(run, std::move(snapshot), nullptr, nullptr).folder;
    EXPECT_EQ(error(), prefix +
                           "its newest checkpoint, step_000002345: it holds no policy.safetensors, as "
                           "those of older versions and of agents without policy(): resume the run with "
                           "its train program, which writes one at its end; the one before is " +
                           checkpoint.string());
    fs::remove_all(newest);
    EXPECT_EQ(error(), "no error");
    fs::remove_all(checkpoint);
    EXPECT_EQ(error(), prefix + "it has no checkpoint yet");
    fs::remove(run / "config.yaml");
    EXPECT_EQ(error(), prefix +
                           "it is the folder of neither a run nor a checkpoint; give one of these, such as "
                           "runs/Pong__sac__1 or its checkpoints/step_000100000, or a policy file");
}

TEST(ExportTest, TheWebPageReadsTheGamesOfAPolicyOfSeveral) {
    EnvConfig env;
    env.game = "pong,breakout";
    ConfigTable table;
    table.add("env", env);
    PolicyInfo info;
    for (const auto& line : split(table.to_yaml(), '\n'))  // as policy files have it, without comments
        if (line.find('#') == line.npos) info.provenance["config"] += line + '\n';
    EXPECT_EQ(web::trained_env(info).game, "pong,breakout");
    EXPECT_EQ(env_config_of(info).game, "pong,breakout");
}

TEST(ExportTest, AConfigurationThatIsNone) {
    PolicyInfo info;
    info.game = "Pong";
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { env_config_of(info); }), HasSubstr("it holds none"));
    info.provenance["config"] = "train:\n  seed: 1\n";
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { env_config_of(info); }),
                HasSubstr("it has no section env"));
    info.provenance["config"] = "env:\n  game: pong\n  colour: red\n";
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { env_config_of(info); }), HasSubstr("env.colour"));
    info.provenance["config"] = "env: [";
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { env_config_of(info); }),
                HasSubstr("policy of Pong"));
}

TEST(ExportTest, TheWebPageSaysWhatItCannotRead) {
    PolicyInfo info;
    const auto error = [&] { return test::error_of<std::runtime_error>([&] { web::trained_env(info); }); };
    EXPECT_EQ(error(), "this policy does not say in which environment it was trained");
    info.provenance["config"] = "env:\n  colour: red\n";
    EXPECT_THAT(error(),
                HasSubstr("this page is older than the policy: of its environment, there is no setting "
                          "'colour'"));
    info.provenance["config"] = "env:\n  threshold: 7\n";
    EXPECT_THAT(error(), HasSubstr("cannot be used: threshold must be 0 to 1, not '7'"));
}

TEST(ExportTest, TheWebPagesChangesAreLinesOfSettings) {
    EnvConfig env;
    web::change(env, "threshold=0.25\n\nstick_speed=0.2\n");
    EXPECT_EQ(web::setting(env, "threshold"), "0.25");
    EXPECT_EQ(web::setting(env, "stick_speed"), "0.2");
    EXPECT_THROW(web::change(env, "threshold"), std::invalid_argument);
    EXPECT_THROW(web::change(env, "colour=red"), std::invalid_argument);
}

}  // namespace
}  // namespace cale
