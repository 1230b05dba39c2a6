// The agent's file of a checkpoint: what it leaves out, and that everything comes back.
#include "train/agent_file.h"

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "agents/sac.h"
#include "storage/files.h"
#include "support/temporary_folder.h"
#include "train/safetensors.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class AgentFile : public testing::Test {
  protected:
    fs::path path() const { return folder / kAgentFile; }
    std::string refusal() const {
        return test::error_of<std::runtime_error>([&] { load_agent(folder.path()); });
    }
    /// Whether they are the same to the bit, under the same names.
    static void expect_same(const TensorMap& found, const TensorMap& expected) {
        ASSERT_EQ(found.size(), expected.size());
        for (const auto& [name, tensor] : expected) {
            ASSERT_TRUE(found.contains(name)) << name;
            const auto& other = found.at(name);
            ASSERT_EQ(other.scalar_type(), tensor.scalar_type()) << name;
            ASSERT_EQ(other.sizes(), tensor.sizes()) << name;
            const auto whole = tensor.contiguous();
            EXPECT_TRUE(std::string_view(static_cast<const char*>(other.const_data_ptr()), other.nbytes()) ==
                        std::string_view(static_cast<const char*>(whole.const_data_ptr()), whole.nbytes()))
                << name;
        }
    }

    test::TemporaryFolder folder;
};

TEST_F(AgentFile, BringsBackEveryBit) {
    const auto weights = torch::randn({64, 32});
    auto negative_zeros = torch::zeros({64, 32});
    negative_zeros.neg_();
    const TensorMap state{{"a", weights},
                          {"b", weights.clone()},
                          {"nan", torch::full({2048}, std::numeric_limits<double>::quiet_NaN())},
                          {"strided", weights.t()},
                          {"other_shape", weights.clone().view({32, 64})},
                          {"zero", torch::zeros({64, 32})},
                          {"negative_zero", negative_zeros},
                          {"whole", torch::zeros({64, 32}, torch::kInt32)},
                          {"counter", torch::tensor(std::int64_t{7})},
                          {"nothing", torch::empty({0, 84}, torch::kUInt8)},
                          {"bytes", torch::arange(5000, torch::kInt64).to(torch::kUInt8)}};
    save_agent(folder.path(), state);
    const auto loaded = load_agent(folder.path());
    expect_same(loaded, state);
    loaded.at("b").fill_(1);
    EXPECT_TRUE(at::equal(loaded.at("a"), weights)) << "each has memory of its own";
}

TEST_F(AgentFile, StoresATargetAndMomentsOnlyOnceTheyDiffer) {
    const auto network = torch::randn({256, 256}), moment = torch::zeros({256, 256});
    TensorMap state{{"network/w", network},
                    {"target/w", network.clone()},
                    {"adam/first_moment.0", moment},
                    {"adam/second_moment.0", moment.clone()}};
    save_agent(folder.path(), state);
    const auto before = fs::file_size(path());
    EXPECT_LT(before, network.nbytes()) << "one network, and no zeros";
    state["target/w"] = torch::randn({256, 256});
    save_agent(folder.path(), state);
    EXPECT_GT(fs::file_size(path()), 3 * before / 2);
    expect_same(load_agent(folder.path()), state);
}

TEST_F(AgentFile, OfSacBeforeItsFirstUpdateIsAsLargeAsOneNetwork) {
    SacConfig config;
    config.network.encoder = EncoderKind::phi_dqn;
    config.network.hidden_units = 64;
    config.replay.replay_capacity = 100;
    const auto agent = make_sac(config, {});
    const auto state = agent->state();
    std::uint64_t network = 0, all = 0;
    for (const auto& [name, tensor] : state) {
        all += tensor.nbytes();
        if (name.starts_with("network/")) network += tensor.nbytes();
    }
    save_agent(folder.path(), state);
    EXPECT_LT(fs::file_size(path()), network + 20'000);
    EXPECT_GT(all, 3 * network);
    expect_same(load_agent(folder.path()), state);
}

TEST_F(AgentFile, IsRefusedWhereItIsDamaged) {
    EXPECT_THAT(refusal(), HasSubstr("agent.safetensors.zst"));
    save_agent(folder.path(), {{"w", torch::randn({64, 64})}});
    const auto good = read_file(path());
    const auto refused = [&](std::string_view bytes) {
        write_file_atomically(path(), bytes);
        return refusal();
    };
    EXPECT_EQ(refused(good), "no error");
    for (const std::size_t size : {std::size_t{0}, std::size_t{3}, std::size_t{20}, good.size() - 1})
        EXPECT_THAT(refused(std::string_view(good).substr(0, size)),
                    AllOf(HasSubstr(path().string()), HasSubstr("cannot be used")))
            << size;
    auto flipped = good;
    flipped[flipped.size() / 2] = static_cast<char>(flipped[flipped.size() / 2] ^ 1);
    EXPECT_THAT(refused(flipped), HasSubstr("it is damaged (zstd: "));
    EXPECT_THAT(refused("no zstd at all"), HasSubstr("does not begin as a file that zstd has compressed"));
    // A frame that promises 2^60 bytes.
    const std::string promise("\x28\xb5\x2f\xfd\xc0\0\0\0\0\0\0\0\0\x10", 14);
    EXPECT_THAT(refused(promise + std::string(64, '\0')), HasSubstr("does not begin as a file"));
}

/// The bytes as zstd stores what cannot be compressed: a frame of one raw block, without a checksum.
std::string frame_of(std::string_view bytes) {
    std::string frame("\x28\xb5\x2f\xfd\xa0", 5);
    const auto add = [&](std::size_t number, int count) {
        for (; count > 0; --count, number >>= 8) frame += static_cast<char>(number & 0xff);
    };
    add(bytes.size(), 4);
    add(bytes.size() << 3 | 1, 3);
    return frame.append(bytes);
}

TEST_F(AgentFile, IsRefusedWhereItNamesAnAbsentTensor) {
    using Names = std::map<std::string, std::string>;
    const auto read = [&](const Names& same) {
        save_safetensors(folder / "plain", {{"network/w", torch::ones({4, 4})}}, same);
        write_file_atomically(path(), frame_of(read_file(folder / "plain")));
        return refusal();
    };
    EXPECT_EQ(read({{"target/w", "network/w"}}), "no error");
    for (const auto& same : {Names{{"target/w", "absent"}}, Names{{"network/w", "network/w"}}})
        EXPECT_THAT(read(same), HasSubstr("its metadata name a tensor that is not there, or one that is"));
}

}  // namespace
}  // namespace cale
