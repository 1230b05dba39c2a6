#include "settings/peer_names.h"

#include <algorithm>

namespace cale {

std::span<const PeerName> peer_names() {
    static constexpr PeerName kNames[] = {
        {"action_map", "env.event_map"},
        {"anneal_lr", "agent.anneal_learning_rate"},
        {"buffer_size", "agent.replay_capacity"},
        {"capture_video", "eval.video"},
        {"clip_coef", "agent.clip"},
        {"clip_range", "agent.clip"},
        {"clip_reward", "agent.reward_clip"},
        {"clip_rewards", "agent.reward_clip"},
        {"continuous_action_threshold", "env.threshold"},
        {"discount", "agent.gamma"},
        {"ent_coef", "agent.entropy_coefficient"},
        {"ent_coef", "agent.initial_alpha"},
        {"env_id", "env.game"},
        {"episodic_life", "env.terminal_on_life_loss"},
        {"eval_episodes", "eval.episodes"},
        {"eval_freq", "eval.every"},
        {"exploration_strategy", "agent.exploration"},
        {"full_action_space", "env.action_space"},
        {"learning_starts", "agent.min_replay"},
        {"lr", "agent.learning_rate"},
        {"max_episode_steps", "env.max_frames_per_episode"},
        {"max_grad_norm", "agent.max_gradient_norm"},
        {"memory_size", "agent.replay_capacity"},
        {"min_replay_history", "agent.min_replay"},
        {"n_atoms", "agent.num_atoms"},
        {"n_envs", "env.num_envs"},
        {"n_epochs", "agent.epochs"},
        {"n_eval_episodes", "eval.episodes"},
        {"n_step", "agent.update_horizon"},
        {"n_steps", "agent.rollout_steps"},
        {"n_steps", "agent.update_horizon"},
        {"num_layers", "agent.hidden_layers"},
        {"num_minibatches", "agent.minibatch_size"},
        {"num_steps", "agent.rollout_steps"},
        {"num_steps", "train.total_steps"},
        {"obs_type", "env.obs"},
        {"policy_lr", "agent.learning_rate"},
        {"q_lr", "agent.learning_rate"},
        {"repeat_action_probability", "env.sticky_probability"},
        {"replay_size", "agent.replay_capacity"},
        {"save_freq", "train.checkpoint_every"},
        {"stack_num", "env.frame_stack"},
        {"stack_size", "env.frame_stack"},
        {"start_steps", "agent.min_replay"},
        {"sticky_actions", "env.sticky_probability"},
        {"target_network_frequency", "agent.target_update_period"},
        {"target_update_interval", "agent.target_update_period"},
        {"total_frames", "train.total_steps"},
        {"total_timesteps", "train.total_steps"},
        {"train_freq", "agent.update_period"},
        {"train_frequency", "agent.update_period"},
        {"update_epochs", "agent.epochs"},
        {"v_max", "agent.value_limit"},
        {"vf_coef", "agent.value_coefficient"},
        {"vmax", "agent.value_limit"},
    };
    return kNames;
}

std::string key_of_peer(std::string_view name, std::span<const ConfigEntry> entries) {
    for (const auto& [theirs, key] : peer_names())
        if (theirs == name && std::ranges::find(entries, key, &ConfigEntry::key) != entries.end())
            return std::string(key);
    return "";
}

}  // namespace cale
