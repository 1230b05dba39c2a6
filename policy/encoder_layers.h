// The layers of the encoders that agents choose from, and of what follows them.
//   phi_sac  Yarats et al. 2021, "Improving Sample Efficiency in Model-Free RL from Images",
//            with padded convolutions as in Farebrother & Castro 2024 (CALE)
//   phi_dqn  Mnih et al. 2015, "Human-level control through deep reinforcement learning"
//   data_efficient  van Hasselt, Hessel & Aslanides 2019, "When to use parametric models in reinforcement
//                   learning?", appendix E (data-efficient Rainbow)
//   phi_dqn_2013  Mnih et al. 2013, "Playing Atari with Deep Reinforcement Learning", section 4.1
//   compact  Fujimoto et al. 2025, "Towards General-Purpose Model-Free RL" (MR.Q), appendix B, with ReLU
//   impala   Espeholt et al. 2018, "IMPALA", figure 3 right, without the LSTM
#pragma once

#include <string>

#include "policy/network_spec.h"

namespace cale {

/// conv1 to conv4: 32@3x3/2, three times 32@3x3/1, ReLU; flattened.
Layers phi_sac(Padding padding = Padding::same);
/// conv1 to conv3: 32@8x8/4, 64@4x4/2, 64@3x3/1, ReLU; flattened. `rows`: each row of the image by itself.
Layers phi_dqn(Padding padding = Padding::same, bool rows = false);
/// 16, 32 and 32 channels: stage1_conv (3x3), max pool 3x3/2 and two residual blocks stage1_block1_conv1,
/// ...; then ReLU; flattened. Always padded: a residual block adds what enters it to what leaves it.
Layers impala();
/// conv1 to conv4: 32@3x3/2, 32@3x3/2, 32@3x3/2, 32@3x3/1, ReLU, not padded; flattened: 1,568 numbers of an
/// 84x84 frame.
Layers compact();
/// conv1, conv2: 32@5x5/5, 64@5x5/5, ReLU, not padded; flattened: 576 numbers of an 84x84 frame, after 1.3
/// million multiplications where compact has 6.8.
Layers data_efficient();
/// conv1, conv2: 16@8x8/4, 32@4x4/2, ReLU, not padded; flattened: 2,592 numbers of an 84x84 frame, after 2.3
/// million multiplications.
Layers phi_dqn_2013();
/// fc1, fc2: two dense layers of 256 units, each with ReLU, on the flattened observation. For observations
/// that are no images, such as the console's 128 bytes of RAM: the size of Stable-Baselines3's networks for
/// state vectors. 84x84 frames work too. `layer_norm`: before each ReLU.
Layers mlp(bool layer_norm = false);
/// No layer at all: the observation's numbers one behind the other.
Layers flat();

/// The narrow branch of CALE's agents: `name`_fc (50 units), `name`_ln, tanh. Which encoder has which is in
/// networks/encoder_table.cpp.
Layers tanh_branch(const std::string& name);
/// The wide branch: `name`_fc (512 units), `name`_ln where `layer_norm`, ReLU.
Layers relu_branch(const std::string& name, bool layer_norm);

}  // namespace cale
