# cmake -DBIN_DIR=... -DSOURCE_DIR=... -DPOLICY=... -P make_policy.cmake: plays for a moment and exports the policy.
cmake_path(GET POLICY PARENT_PATH folder)
file(REMOVE_RECURSE ${folder}/policy_run)
file(MAKE_DIRECTORY ${folder})
foreach(command
        "${BIN_DIR}/train_sac;--config;${SOURCE_DIR}/configs/sac/atari100k.yaml;--run-dir;${folder}/policy_run;--no-progress;env.game=breakout;env.max_frames_per_episode=200;train.total_steps=40;agent.min_replay=100;eval.episodes=0"
        "${BIN_DIR}/cale;export;${folder}/policy_run;-o;${POLICY}")
    execute_process(COMMAND ${command} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
    if(NOT status EQUAL 0)
        list(JOIN command " " text)
        message(FATAL_ERROR "failed: ${text}\n${output}")
    endif()
endforeach()
