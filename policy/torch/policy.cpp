#include "policy/torch/policy.h"

#include <functional>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <torch/types.h>
#include <torch/utils.h>

#include "networks/discrete_actions.h"
#include "networks/heads.h"
#include "policy/policy_file.h"
#include "policy/torch/actor_network.h"

namespace cale {
namespace {

/// CUDA multiplies in TF32 where it may.
constexpr double kCudaGoldenTolerance = 1e-2;

ActionBox box_on(torch::Device device, ActionBox box) {
    box.centre = box.centre.to(device);
    box.half_width = box.half_width.to(device);
    return box;
}

/// A view of bytes that must not be written through: LibTorch has no constant tensors.
torch::Tensor view_of(std::span<const std::uint8_t> observation, std::vector<std::int64_t> shape) {
    const auto size = std::reduce(shape.begin(), shape.end(), std::int64_t{1}, std::multiplies());
    if (std::ssize(observation) != size) {
        throw std::invalid_argument("an observation has " + std::to_string(observation.size()) +
                                    " bytes: it must have " + std::to_string(size));
    }
    shape.insert(shape.begin(), 1);
    return torch::from_blob(const_cast<std::uint8_t*>(observation.data()), shape, torch::kUInt8);
}

/// As of policy_lite.
void require_finite(const torch::Tensor& output) {
    if (output.isfinite().all().item<bool>()) return;
    throw std::runtime_error("the policy's network gives a number that is not finite for this observation");
}

}  // namespace

struct Policy::Impl {
    Impl(const PolicyFile& file, torch::Device own_device)
        : info(file.info),
          head(file.network.head.kind),
          noisy(is_noisy(file.network)),
          observation(file.network.observation),
          device(own_device),
          network(file.network, file.weights, device),
          random_box(action_box(joystick_space(file.info.joystick))),
          box(box_on(device, random_box)) {}

    torch::Tensor output(const torch::Tensor& observations,
                         const std::optional<at::Generator>& noise = std::nullopt) const {
        return network.output(observations.to(device), {}, noise);
    }

    torch::Tensor greedy(const torch::Tensor& output) const {
        require_finite(output);
        if (!info.actions.empty()) return output.argmax(1).cpu();
        return mean_action(squashed_gaussian(output), box).cpu();
    }

    torch::Tensor sampled(const torch::Tensor& output, at::Generator& random) const {
        require_finite(output);
        if (!info.actions.empty()) return output.exp().cpu().multinomial(1, true, random).squeeze(1);
        const auto noise = torch::randn({output.size(0), output.size(1) / 2}, random).to(device);
        return sample(squashed_gaussian(output), noise, box).action.cpu();
    }

    /// Replaces each action by a uniform one with probability info.epsilon.
    torch::Tensor explored(const torch::Tensor& actions, at::Generator& random) const {
        return info.actions.empty() ? epsilon_greedy(actions, info.epsilon, random_box, random)
                                    : epsilon_greedy(actions, info.epsilon, info.num_actions(), random);
    }

    PolicyInfo info;
    Head::Kind head;
    bool noisy;                             // is_noisy()
    std::vector<std::int64_t> observation;  // its shape
    torch::Device device;
    ActorNetwork network;
    ActionBox random_box;  // on the CPU, where random actions are drawn
    ActionBox box;         // of the network's actions, on its device
};

Policy Policy::load(const std::filesystem::path& file, torch::Device device) {
    return parse(read_whole_file(file), file.string(), device);
}

Policy Policy::parse(std::string_view contents, const std::string& name, torch::Device device) {
    try {
        const auto file = parse_policy_file(contents);
        Policy policy;
        policy.impl_ = std::make_shared<const Impl>(file, device);
        const auto output =
            policy.output(view_of(file.golden.observation, file.network.observation)).contiguous();
        check_golden({output.const_data_ptr<float>(), static_cast<std::size_t>(output.numel())},
                     file.golden.output, device.is_cpu() ? kGoldenTolerance : kCudaGoldenTolerance);
        return policy;
    } catch (const FileDamage& damage) {
        throw std::runtime_error("'" + name + "' cannot be used: " + damage.what());
    }
}

const PolicyInfo& Policy::info() const {
    return impl_->info;
}

torch::Device Policy::device() const {
    return impl_->device;
}

torch::Tensor Policy::output(const torch::Tensor& observations) const {
    const torch::NoGradGuard no_grad;
    return impl_->output(observations).cpu();
}

bool Policy::gives_action_values() const {
    return impl_->head == Head::Kind::values;
}

torch::Tensor Policy::act(const torch::Tensor& observations) const {
    const torch::NoGradGuard no_grad;
    return impl_->greedy(impl_->output(observations));
}

torch::Tensor Policy::act(const torch::Tensor& observations, Choice choice, at::Generator random) const {
    const torch::NoGradGuard no_grad;
    const bool evaluated = choice == Choice::as_evaluated;
    const bool sampled = draws(impl_->info, choice);
    const auto output =
        impl_->output(observations, sampled && impl_->noisy ? std::optional(random) : std::nullopt);
    // Action values are no distribution: what is drawn of them is their noise.
    const bool has_distribution = impl_->head != Head::Kind::values;
    const auto actions = sampled && has_distribution ? impl_->sampled(output, random) : impl_->greedy(output);
    // A noisy agent draws for an epsilon of 0, too, and the next noise comes after it.
    const bool explores = impl_->info.epsilon > 0 || impl_->noisy;
    return evaluated && explores ? impl_->explored(actions, random) : actions;
}

namespace {

/// One action [1, coordinates] or [1] as a decision.
Decision decision_of(const PolicyInfo& info, const torch::Tensor& action) {
    if (!info.actions.empty()) return decision(info, action.item<std::int64_t>());
    const auto row = action.contiguous();
    const std::span coordinates(row.const_data_ptr<float>(), static_cast<std::size_t>(row.numel()));
    return decision(info, stick(info.joystick, coordinates));
}

}  // namespace

Decision Policy::act(std::span<const std::uint8_t> observation) const {
    return decision_of(info(), act(view_of(observation, impl_->observation)));
}

Decision Policy::act(std::span<const std::uint8_t> observation, Choice choice, at::Generator random) const {
    return decision_of(info(), act(view_of(observation, impl_->observation), choice, std::move(random)));
}

}  // namespace cale
