#include "tools/completion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>

#include "agents/dqn.h"
#include "storage/files.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSupersetOf;

std::vector<CommandWords> programs() {
    const CommandWords evaluate{.name = "evaluate",
                                .help = "plays: 'games'",
                                .argument = "RUN",
                                .options = {{"--episodes", "N", "games"},
                                            {"--protocol", "NAME:{fixed_episodes,fixed_steps}", "which"},
                                            {"--video", "", "film [one]"}}};
    const CommandWords games{.name = "games", .help = "lists", .argument = "GAME"};
    return {{.name = "cale", .options = {{"--version", "", "print it"}}, .subcommands = {evaluate, games}},
            train_words("dqn", make_dqn)};
}

/// What bash offers for the last of these words.
std::vector<std::string> bash_offers(const std::string& words) {
    const test::TemporaryFolder folder;
    const auto script = folder.path() / "cale.bash";
    write_file_atomically(script, completion_script("bash", programs()));
    const std::string command =
        "bash -c 'source " + script.string() + "; COMP_WORDS=(" + words +
        "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _cale; printf \"%s\\n\" \"${COMPREPLY[@]}\"' 2>/dev/null";
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
    std::vector<std::string> offers;
    char line[4096];
    while (std::fgets(line, sizeof(line), pipe.get()) != nullptr) {
        std::string word(line);
        while (!word.empty() && (word.back() == '\n' || word.back() == ' ')) word.pop_back();
        if (!word.empty()) offers.push_back(word);
    }
    return offers;
}

TEST(Completion, BashCompletesSubcommandsOptionsAndTheirValues) {
    EXPECT_THAT(bash_offers("cale ev"), ElementsAre("evaluate"));
    EXPECT_THAT(bash_offers("cale evaluate --e"), ElementsAre("--episodes"));
    EXPECT_THAT(bash_offers("cale evaluate --protocol fixed_s"), ElementsAre("fixed_steps"));
    EXPECT_THAT(bash_offers("cale evaluate --episodes \"\""), IsEmpty());
    EXPECT_THAT(bash_offers("cale games brea"), ElementsAre("breakout"));
    EXPECT_THAT(bash_offers("cale --v"), ElementsAre("--version"));
}

TEST(Completion, BashCompletesSettingsAndTheirValues) {
    EXPECT_THAT(bash_offers("train_dqn --see"), ElementsAre("--seed"));
    EXPECT_THAT(bash_offers("/usr/bin/train_dqn env.thr"), ElementsAre("env.threshold="));
    EXPECT_THAT(bash_offers("train_dqn --set train.to"), ElementsAre("train.total_steps="));
    EXPECT_THAT(bash_offers("train_dqn --set env.game = brea"), ElementsAre("breakout"));
    EXPECT_THAT(bash_offers("train_dqn env.action_space ="), IsSupersetOf({"minimal", "full"}));
    EXPECT_THAT(bash_offers("train_dqn env.terminal_on_life_loss = t"), ElementsAre("true"));
    EXPECT_THAT(bash_offers("train_dqn env.threshold ="), IsEmpty());
    EXPECT_THAT(bash_offers("train_dqn --env-id ms"), ElementsAre("ms_pacman"));
    EXPECT_THAT(bash_offers("train_dqn --device = cu"), ElementsAre("cuda"));
}

TEST(Completion, KnowsEverySettingOfAnAgent) {
    const auto words = train_words("dqn", make_dqn);
    RunConfig<DqnConfig> config;
    const auto table = settings_of(config);
    ASSERT_EQ(words.settings.size(), table.entries().size());
    for (const auto* shell : {"bash", "zsh", "fish"}) {
        const auto script = completion_script(shell, programs());
        for (const auto& entry : table.entries()) EXPECT_THAT(script, HasSubstr(entry.key)) << shell;
    }
}

TEST(Completion, ZshAndFishAreGivenSentencesWithTheirSpecialSignsQuoted) {
    const auto zsh = completion_script("zsh", programs());
    EXPECT_THAT(zsh, HasSubstr("#compdef cale train_dqn\n"));
    EXPECT_THAT(zsh, HasSubstr(R"('evaluate:plays\: '\''games'\''')"));
    EXPECT_THAT(zsh, HasSubstr(R"('*--video[film \[one\]]')"));
    EXPECT_THAT(zsh, HasSubstr("'*--protocol[which]: :(fixed_episodes fixed_steps)'"));
    const auto fish = completion_script("fish", programs());
    EXPECT_THAT(fish,
                HasSubstr(R"(complete -c cale -n __fish_use_subcommand -a evaluate -d 'plays: \'games\'')"));
    EXPECT_THAT(fish,
                HasSubstr("complete -c cale -n '__fish_seen_subcommand_from evaluate' -l protocol -x -a "
                          "'fixed_episodes fixed_steps' -d 'which'"));
}

TEST(Completion, RefusesAnotherShell) {
    EXPECT_THROW(completion_script("tcsh", programs()), std::invalid_argument);
}

}  // namespace
}  // namespace cale
