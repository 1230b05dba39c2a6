#include "policy/policy_lite.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "policy/inference_plan.h"
#include "policy/kernels.h"
#include "policy/network_parameters.h"

namespace cale::lite {
namespace {

constexpr std::size_t kMostCoordinates = 4;
using Coordinates = std::array<float, kMostCoordinates>;  // as many as the policy's joystick has

/// The joystick at x, each coordinate from -1 to 1.
Decision in_box(const PolicyInfo& info, Coordinates x) {
    const auto box = stick_coordinates(info.joystick);
    for (std::size_t i = 0; i < box.size(); ++i) {
        const auto& [name, low, high] = box[i];
        x[i] = (low + high) / 2 + (high - low) / 2 * x[i];
    }
    return decision(info, stick(info.joystick, std::span(x).first(box.size())));
}

float uniform(std::mt19937_64& random) {
    return static_cast<float>(random() >> 40) * 0x1p-24f;  // [0, 1)
}

void require_finite(std::span<const float> output) {
    if (std::ranges::all_of(output, [](float number) { return std::isfinite(number); })) return;
    throw std::runtime_error("the policy's network gives a number that is not finite for this observation");
}

Decision greedy(const PolicyInfo& info, std::span<const float> output) {
    require_finite(output);
    if (info.actions.empty()) return squashed_decision(info, output.first(output.size() / 2));
    return decision(info, std::max_element(output.begin(), output.end()) - output.begin());
}

Decision sampled(const PolicyInfo& info, std::span<const float> output, std::mt19937_64& random) {
    require_finite(output);
    if (info.actions.empty()) {
        std::normal_distribution<float> normal;
        const auto size = output.size() / 2;
        Coordinates u{};
        for (std::size_t i = 0; i < size; ++i) u[i] = output[i] + std::exp(output[size + i]) * normal(random);
        return squashed_decision(info, std::span(u).first(size));
    }
    double left = uniform(random);
    std::int64_t action = 0;
    for (; action + 1 < info.num_actions(); ++action) {
        left -= std::exp(static_cast<double>(output[static_cast<std::size_t>(action)]));
        if (left < 0) break;
    }
    return decision(info, action);
}

Decision uniform_decision(const PolicyInfo& info, std::mt19937_64& random) {
    if (info.actions.empty()) {
        Coordinates x{};
        for (std::size_t i = 0; i < stick_coordinates(info.joystick).size(); ++i)
            x[i] = 2 * uniform(random) - 1;
        return in_box(info, x);
    }
    return decision(info, static_cast<std::int64_t>(random() % info.actions.size()));
}

Decision chosen(const InferencePlan& plan, std::span<const float> numbers, Choice choice,
                std::mt19937_64& random) {
    const auto& info = plan.info;
    const bool evaluated = choice == Choice::as_evaluated;
    if (evaluated && info.epsilon > 0 && static_cast<double>(uniform(random)) <= info.epsilon)
        return uniform_decision(info, random);
    // Action values are no distribution: what is drawn of them is their noise.
    const bool has_distribution = plan.head.kind != Head::Kind::values;
    return draws(info, choice) && has_distribution ? sampled(info, numbers, random) : greedy(info, numbers);
}

void require_own(const std::shared_ptr<const InferencePlan>& plan,
                 const std::shared_ptr<const InferencePlan>& of_workspace) {
    if (of_workspace != plan) throw std::invalid_argument("this workspace was made by another policy");
}

}  // namespace

Decision squashed_decision(const PolicyInfo& info, std::span<const float> u) {
    Coordinates x{};
    if (u.size() != stick_coordinates(info.joystick).size())
        throw std::invalid_argument("a draw has as many numbers as the joystick has coordinates");
    std::transform(u.begin(), u.end(), x.begin(), [](float number) { return std::tanh(number); });
    return in_box(info, x);
}

Policy Policy::load(const std::filesystem::path& file) {
    return parse(read_whole_file(file), file.string());
}

Policy Policy::parse(std::string_view contents, const std::string& name) {
    try {
        const auto file = parse_policy_file(contents);
        Policy policy(std::make_shared<const InferencePlan>(file));
        auto workspace = policy.workspace();
        check_golden(policy.output(file.golden.observation, workspace), file.golden.output, kGoldenTolerance);
        return policy;
    } catch (const FileDamage& damage) {
        throw std::runtime_error("'" + name + "' cannot be used: " + damage.what());
    }
}

const PolicyInfo& Policy::info() const {
    return plan_->info;
}

std::size_t Policy::output_size() const {
    return static_cast<std::size_t>(cale::output_size(plan_->head));
}
bool Policy::gives_action_values() const {
    return plan_->head.kind == Head::Kind::values;
}

Workspace Policy::workspace(std::size_t observations) const {
    if (observations == 0) throw std::invalid_argument("a workspace has room for at least one observation");
    Workspace workspace;
    if (observations > workspace.numbers_.max_size() / plan_->memory_size)
        throw std::length_error("a workspace for " + std::to_string(observations) +
                                " observations is larger than any memory");
    workspace.plan_ = plan_;
    workspace.numbers_.resize(plan_->memory_size * observations);
    return workspace;
}

std::span<const float> Policy::output(std::span<const std::uint8_t> observation, Workspace& workspace) const {
    return output(observation, workspace, nullptr);
}

std::span<const float> Policy::newest_output(const Workspace& workspace) const {
    require_own(plan_, workspace.plan_);
    return plan_->output(workspace.numbers_, 0);
}

std::span<const float> Policy::output(std::span<const std::uint8_t> observation, Workspace& workspace,
                                      std::mt19937_64* noise) const {
    require_own(plan_, workspace.plan_);
    if (observation.size() != info().observation_size()) {
        throw std::invalid_argument("an observation has " + std::to_string(observation.size()) +
                                    " bytes: it must have " + std::to_string(info().observation_size()));
    }
    plan_->run(observation, 1, workspace.numbers_, noise);
    return plan_->output(workspace.numbers_, 0);
}

Decision Policy::act(std::span<const std::uint8_t> observation, Workspace& workspace) const {
    return greedy(info(), output(observation, workspace));
}

Decision Policy::act(std::span<const std::uint8_t> observation, Workspace& workspace, Choice choice,
                     std::mt19937_64& random) const {
    auto* const noise = plan_->noisy && draws(info(), choice) ? &random : nullptr;
    return chosen(*plan_, output(observation, workspace, noise), choice, random);
}

void Policy::act(std::span<const std::uint8_t> observations, std::span<Decision> decisions,
                 Workspace& workspace) const {
    std::mt19937_64 unused;
    act(observations, decisions, workspace, Choice::greedy, unused);
}

void Policy::act(std::span<const std::uint8_t> observations, std::span<Decision> decisions,
                 Workspace& workspace, Choice choice, std::mt19937_64& random) const {
    const auto size = info().observation_size();
    if (observations.size() != decisions.size() * size) {
        throw std::invalid_argument(std::to_string(decisions.size()) + " observations have " +
                                    std::to_string(decisions.size() * size) + " bytes, not " +
                                    std::to_string(observations.size()));
    }
    require_own(plan_, workspace.plan_);
    const bool draws_noise = plan_->noisy && draws(info(), choice);
    // Noise by noise and choice by choice, as one by one.
    const auto room = draws_noise ? 1 : workspace.numbers_.size() / plan_->memory_size;
    for (std::size_t first = 0; first < decisions.size(); first += room) {
        const auto count = std::min(room, decisions.size() - first);
        plan_->run(observations.subspan(first * size, count * size), count, workspace.numbers_,
                   draws_noise ? &random : nullptr);
        for (std::size_t i = 0; i < count; ++i)
            decisions[first + i] = chosen(*plan_, plan_->output(workspace.numbers_, i), choice, random);
    }
}

std::string_view instruction_set() {
    return kernels().name;
}

}  // namespace cale::lite
