#include "train/safetensors.h"

#include <bit>
#include <cstdint>
#include <random>
#include <stdexcept>
#include <string>

#include <ATen/ATen.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "storage/files.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using nlohmann::json;
using test::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

std::string with_length(const std::string& header, const std::string& data = "") {
    const auto length = std::bit_cast<std::array<char, 8>>(std::uint64_t{header.size()});
    return std::string(length.data(), length.size()) + header + data;
}

/// `error` without the start that names the file, which must be there.
std::string after(const std::string& verb, const std::filesystem::path& file, const std::string& end_of_start,
                  const std::string& error) {
    std::string start = verb;
    start.append("'").append(file.string()).append("'").append(end_of_start);
    EXPECT_EQ(error.substr(0, start.size()), start);
    return error.substr(std::min(start.size(), error.size()));
}

/// What is wrong with a file of these contents.
std::string load_error(const TemporaryFolder& folder, const std::string& contents) {
    const auto file = folder.write("x.safetensors", contents);
    return after("", file,
                 " cannot be used: ", test::error_of<std::runtime_error>([&] { load_safetensors(file); }));
}

json tensor_entry(const std::string& dtype, const json& shape, std::uint64_t begin, std::uint64_t end) {
    return {{"dtype", dtype}, {"shape", shape}, {"data_offsets", {begin, end}}};
}

std::string tensor_error(const json& entry, std::size_t data_size) {
    const TemporaryFolder folder;
    return load_error(folder, with_length(json{{"a", entry}}.dump(), std::string(data_size, '\0')));
}

TensorMap example() {
    return {{"bool", at::tensor({1, 0, 1}).to(at::kBool)},
            {"conv.weight", at::arange(12, at::kFloat).view({3, 2, 2}) / 7},
            {"empty", at::zeros({0, 4}, at::kDouble)},
            {"half", at::tensor({0.5, -2.0}).to(at::kHalf)},
            {"bf16", at::tensor({1.5}).to(at::kBFloat16)},
            {"int", at::tensor({-1, 70'000}, at::kInt)},
            {"step", at::scalar_tensor(std::int64_t{1} << 40, at::kLong)}};
}

TEST(Safetensors, EveryTypeComesBackBitForBit) {
    TemporaryFolder folder;
    at::manual_seed(1);
    for (const auto type : {at::kDouble, at::kFloat, at::kHalf, at::kBFloat16, at::kLong, at::kInt,
                            at::kShort, at::kChar, at::kByte, at::kBool}) {
        const TensorMap written{{"x", at::randint(0, 2, {5, 3}).to(type)}, {"scalar", at::ones({}).to(type)}};
        save_safetensors(folder / "x", written);
        const auto read = load_safetensors(folder / "x").tensors;
        ASSERT_EQ(read.size(), 2u);
        for (const auto& [name, tensor] : written) {
            EXPECT_EQ(read.at(name).scalar_type(), type);
            EXPECT_EQ(read.at(name).sizes(), tensor.sizes());
            EXPECT_TRUE(at::equal(read.at(name), tensor)) << type;
        }
    }
}

TEST(Safetensors, MixedTypesAndShapes) {
    TemporaryFolder folder;
    save_safetensors(folder / "x", example());
    const auto read = load_safetensors(folder / "x").tensors;
    ASSERT_EQ(read.size(), example().size());
    for (const auto& [name, tensor] : example()) {
        EXPECT_EQ(read.at(name).scalar_type(), tensor.scalar_type()) << name;
        EXPECT_EQ(read.at(name).sizes(), tensor.sizes()) << name;
        EXPECT_TRUE(at::equal(read.at(name), tensor)) << name;
    }
}

TEST(Safetensors, StridedAndTrainedTensorsAreWrittenByValue) {
    TemporaryFolder folder;
    const auto base = at::arange(24, at::kFloat).view({2, 3, 4});
    const auto parameter = at::ones({2}, at::TensorOptions(at::kFloat).requires_grad(true));
    save_safetensors(folder / "x",
                     {{"transposed", base.transpose(0, 2)},
                      {"slice", base.select(1, 1)},
                      {"expanded", at::ones({1}).expand({5})},
                      {"last", at::arange(8).view({1, 2, 2, 2}).contiguous(at::MemoryFormat::ChannelsLast)},
                      {"parameter", parameter * 3}});
    const auto read = load_safetensors(folder / "x").tensors;
    EXPECT_TRUE(at::equal(read.at("transposed"), base.transpose(0, 2)));
    EXPECT_TRUE(at::equal(read.at("slice"), base.select(1, 1)));
    EXPECT_TRUE(at::equal(read.at("expanded"), at::ones({5})));
    EXPECT_TRUE(at::equal(read.at("last"), at::arange(8).view({1, 2, 2, 2})));
    EXPECT_TRUE(at::equal(read.at("parameter"), at::full({2}, 3.0)));
    EXPECT_FALSE(read.at("parameter").requires_grad());
}

TEST(Safetensors, MetadataComesBack) {
    TemporaryFolder folder;
    const std::map<std::string, std::string> metadata{
        {"game", "pong"}, {"quote", "\"\\\n\xc3\xa9"}, {"empty", ""}};
    save_safetensors(folder / "x", {}, metadata);
    EXPECT_EQ(load_safetensors(folder / "x").metadata, metadata);
    EXPECT_TRUE(load_safetensors(folder / "x").tensors.empty());
    save_safetensors(folder / "x", {});
    EXPECT_TRUE(load_safetensors(folder / "x").metadata.empty());
}

TEST(Safetensors, TheBytesAreTheFormats) {
    TemporaryFolder folder;
    save_safetensors(folder / "x", {{"a", at::tensor({1, 2}).to(at::kByte)}, {"b", at::tensor({1.0f})}},
                     {{"k", "v"}});
    const auto file = folder.read("x");
    std::uint64_t length = 0;
    std::memcpy(&length, file.data(), 8);
    EXPECT_EQ(length % 8, 0u);
    EXPECT_EQ(json::parse(file.substr(8, length)),
              (json{{"__metadata__", {{"k", "v"}}},
                    {"b", tensor_entry("F32", {1}, 0, 4)},  // the widest first, so that each is aligned
                    {"a", tensor_entry("U8", {2}, 4, 6)}}));
    EXPECT_EQ(file.substr(8 + length), std::string("\x00\x00\x80\x3f\x01\x02", 6));
}

TEST(Safetensors, ReadsWhatOthersWrite) {
    // As the format's own description gives it: an unpadded header, tensors in any order.
    TemporaryFolder folder;
    const auto header =
        json{{"second", tensor_entry("I16", {2}, 4, 8)}, {"first", tensor_entry("I32", json::array(), 0, 4)}}
            .dump();
    folder.write("x", with_length(header + "   ", std::string("\x07\0\0\0\x01\0\xff\xff", 8)));
    const auto read = load_safetensors(folder / "x").tensors;
    EXPECT_EQ(read.at("first").item<int>(), 7);
    EXPECT_EQ(read.at("first").dim(), 0);
    EXPECT_TRUE(at::equal(read.at("second"), at::tensor({1, -1}).to(at::kShort)));
}

TEST(Safetensors, WhatCannotBeSaved) {
    TemporaryFolder folder;
    const auto file = folder / "x";
    const auto error = [&](const TensorMap& tensors,
                           const std::map<std::string, std::string>& metadata = {}) {
        return after("cannot save ", file, ": ", test::error_of<std::invalid_argument>([&] {
                         save_safetensors(file, tensors, metadata);
                     }));
    };
    EXPECT_EQ(error({{"w", torch::Tensor()}}), "tensor 'w' is undefined");
    EXPECT_EQ(error({{"__metadata__", at::ones({1})}}),
              "tensor '__metadata__' has the name that the format keeps for metadata");
    EXPECT_THAT(error({{"c", at::zeros({1}, at::kComplexFloat)}}),
                HasSubstr("tensor 'c' is a CPUComplexFloatType tensor"));
    EXPECT_THAT(error({{"s", at::ones({2, 2}).to_sparse()}}), HasSubstr("which the format does not know"));
    EXPECT_EQ(error({{"\xff", at::ones({1})}}), "a name or a metadata text is not valid UTF-8");
    EXPECT_EQ(error({}, {{"k", "\xff"}}), "a name or a metadata text is not valid UTF-8");
    EXPECT_EQ(folder.file_count(), 0u);
}

TEST(Safetensors, SavingReplacesTheFileAndLeavesNoOther) {
    TemporaryFolder folder;
    save_safetensors(folder / "x", {{"a", at::ones({1000})}});
    save_safetensors(folder / "x", {{"b", at::ones({1})}});
    EXPECT_EQ(load_safetensors(folder / "x").tensors.count("b"), 1u);
    EXPECT_EQ(folder.file_count(), 1u);
    const auto missing = folder / "no/x";
    EXPECT_EQ(test::error_of<std::runtime_error>([&] { save_safetensors(missing, {}); }),
              "cannot write '" + missing.string() + "': No such file or directory");
    EXPECT_EQ(test::error_of<std::runtime_error>([&] { load_safetensors(missing); }),
              "cannot read '" + missing.string() + "': No such file or directory");
}

// ---- damaged files ------------------------------------------------------------------

TEST(SafetensorsDamage, CutOffAnywhere) {
    TemporaryFolder folder;
    save_safetensors(folder / "whole", example(), {{"k", "v"}});
    const auto whole = folder.read("whole");
    for (std::size_t size = 0; size < whole.size(); ++size) {
        folder.write("x", whole.substr(0, size));
        const auto error = test::error_of<std::runtime_error>([&] { load_safetensors(folder / "x"); });
        EXPECT_THAT(error, HasSubstr("x' cannot be used: ")) << size;
    }
}

TEST(SafetensorsDamage, BytesAfterTheEnd) {
    TemporaryFolder folder;
    save_safetensors(folder / "whole", {{"a", at::ones({2})}});
    EXPECT_EQ(load_error(folder, folder.read("whole") + "x"),
              "it has 9 bytes of data where its tensors need 8");
}

TEST(SafetensorsDamage, Headers) {
    TemporaryFolder folder;
    EXPECT_EQ(load_error(folder, ""), "it has 0 bytes, too few for a header");
    EXPECT_EQ(load_error(folder, "1234567"), "it has 7 bytes, too few for a header");
    const std::string huge(8, '\xff');
    EXPECT_EQ(
        load_error(folder, huge + "{}"),
        "its header of 18446744073709551615 bytes does not fit; it is cut off or not a safetensors file");
    EXPECT_EQ(load_error(folder, with_length("")), "its header is not valid JSON");
    EXPECT_EQ(load_error(folder, with_length("{")), "its header is not valid JSON");
    EXPECT_EQ(load_error(folder, with_length("{} {}")), "its header is not valid JSON");
    EXPECT_EQ(load_error(folder, with_length("{\"\xff\":1}")), "its header is not valid JSON");
    EXPECT_EQ(load_error(folder, with_length("[]")), "its header is not a JSON object");
    EXPECT_EQ(load_error(folder, with_length(std::string(1'000'000, '['))),
              "its header is nested too deeply");
    EXPECT_EQ(
        load_error(folder, with_length(R"({"a":{"dtype":"U8","shape":[0],"data_offsets":[0,0]},"a":1})")),
        "its header has 'a' twice");
    EXPECT_EQ(
        load_error(folder,
                   with_length(R"({"a":{"dtype":"U8","dtype":"I8","shape":[0],"data_offsets":[0,0]}})")),
        "its header has 'dtype' twice");
    EXPECT_EQ(load_error(folder, with_length(R"({"a\nb":5})")),
              "tensor 'a\\nb' must have dtype, shape and data_offsets, and nothing else");
    EXPECT_EQ(load_error(folder, with_length(R"({"__metadata__":{"k":5}})")),
              "its metadata 'k' is not a text");
    EXPECT_EQ(load_error(folder, with_length(R"({"__metadata__":[]})")),
              "its __metadata__ must map names to texts");
}

TEST(SafetensorsDamage, Tensors) {
    const auto members = "tensor 'a' must have dtype, shape and data_offsets, and nothing else";
    EXPECT_EQ(tensor_error(5, 0), members);
    EXPECT_EQ(tensor_error({{"dtype", "U8"}, {"shape", {0}}}, 0), members);
    EXPECT_EQ(tensor_error({{"dtype", "U8"}, {"shape", {0}}, {"data_offsets", {0, 0}}, {"x", 1}}, 0),
              members);
    EXPECT_EQ(tensor_error(tensor_entry("F8", {1}, 0, 1), 1), "tensor 'a' has the unknown dtype \"F8\"");
    EXPECT_EQ(tensor_error({{"dtype", 3}, {"shape", {0}}, {"data_offsets", {0, 0}}}, 0),
              "tensor 'a' has the unknown dtype 3");
    EXPECT_EQ(tensor_error(tensor_entry("U8", 5, 0, 5), 5),
              "tensor 'a' must have a list of at most 64 sizes as its shape");
    EXPECT_EQ(tensor_error(tensor_entry("U8", json(65, 1), 0, 1), 1),
              "tensor 'a' must have a list of at most 64 sizes as its shape");
    for (const json& size : {json(-1), json(1.5), json("1"), json(nullptr), json(true), json(1e30)}) {
        EXPECT_EQ(tensor_error(tensor_entry("U8", json::array({size}), 0, 1), 1),
                  "tensor 'a': a size of its shape is not a whole number from 0");
    }
    const auto big = std::uint64_t{1} << 32;
    for (const json& shape : {json{big, big}, json{big, big, big}, json{~std::uint64_t{0}}, json{big, big, 0},
                              json{0, big, big}}) {
        EXPECT_EQ(tensor_error(tensor_entry("U8", shape, 0, 0), 0),
                  "tensor 'a' has a shape with more elements than can be counted");
    }
    EXPECT_EQ(tensor_error(tensor_entry("F32", {std::uint64_t{1} << 61}, 0, 0), 0),
              "tensor 'a' has a shape with more elements than can be counted");
    EXPECT_EQ(tensor_error({{"dtype", "U8"}, {"shape", {0}}, {"data_offsets", {0}}}, 0),
              "tensor 'a' must have two data_offsets");
    EXPECT_EQ(tensor_error({{"dtype", "U8"}, {"shape", {0}}, {"data_offsets", {0, -1}}}, 0),
              "tensor 'a': a data offset is not a whole number from 0");
    EXPECT_EQ(tensor_error(tensor_entry("U8", {4}, 0, 4), 3),
              "tensor 'a' has the data offsets 0 to 4, but the file holds 3 bytes of data");
    EXPECT_EQ(tensor_error(tensor_entry("U8", {0}, 3, 1), 3),
              "tensor 'a' has the data offsets 3 to 1, but the file holds 3 bytes of data");
    EXPECT_EQ(tensor_error(tensor_entry("F32", {2}, 0, 7), 7),
              "tensor 'a' has 7 bytes of data where its shape and dtype need 8");
}

TEST(SafetensorsDamage, TensorsThatOverlapOrLeaveGaps) {
    TemporaryFolder folder;
    const auto two = [&](std::uint64_t begin, std::uint64_t end, std::size_t size) {
        const json header{{"a", tensor_entry("U8", {2}, 0, 2)},
                          {"b", tensor_entry("U8", {end - begin}, begin, end)}};
        return load_error(folder, with_length(header.dump(), std::string(size, '\0')));
    };
    EXPECT_EQ(two(1, 3, 3), "tensor 'b' begins at byte 1 of the data where 2 was expected");
    EXPECT_EQ(two(3, 5, 5), "tensor 'b' begins at byte 3 of the data where 2 was expected");
    EXPECT_EQ(two(0, 2, 2), "tensor 'b' begins at byte 0 of the data where 2 was expected");
}

TEST(SafetensorsDamage, TruthValuesMustBeZeroOrOne) {
    TemporaryFolder folder;
    EXPECT_EQ(
        load_error(folder, with_length(json{{"a", tensor_entry("BOOL", {2}, 0, 2)}}.dump(), "\x01\x02")),
        "tensor 'a' has truth values other than 0 and 1");
}

TEST(SafetensorsDamage, RandomChangesAreRefusedOrHarmless) {
    TemporaryFolder folder;
    save_safetensors(folder / "whole", example(), {{"k", "v"}});
    const auto whole = folder.read("whole");
    std::mt19937 random(3);
    int refused = 0;
    for (int i = 0; i < 1'000; ++i) {
        auto bytes = whole;
        for (int change = 0; change < 2; ++change)
            bytes[random() % bytes.size()] = static_cast<char>(random() % 256);
        folder.write("x", bytes);
        try {
            for (const auto& [name, tensor] : load_safetensors(folder / "x").tensors) {
                EXPECT_LE(tensor.nbytes(), whole.size()) << name;
            }
        } catch (const std::runtime_error& error) {
            EXPECT_THAT(error.what(), HasSubstr("x' cannot be used: "));
            EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
            ++refused;
        }
    }
    EXPECT_GT(refused, 300);
}

}  // namespace
}  // namespace cale
