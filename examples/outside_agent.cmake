# cmake -DBIN_DIR=... -DTRAIN=... -DCONFIG=... -DEMBED=... -DFOLDER=... -P outside_agent.cmake: an agent that the library
# does not know is trained for a moment, resumed, exported, evaluated, and played without LibTorch.
file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${FOLDER})
set(short --no-progress env.game=pong env.max_frames_per_episode=200 eval.episodes=0 ${SETTINGS})
set(policy ${FOLDER}/policy.safetensors)
foreach(command
        "${TRAIN};--config;${CONFIG};--run-dir;${FOLDER}/run;train.total_steps=80;${short}"
        "${TRAIN};--resume;--run-dir;${FOLDER}/run;--config;${FOLDER}/run/config.yaml;--no-progress;train.total_steps=160"
        "${BIN_DIR}/cale;export;${FOLDER}/run;-o;${policy}"
        "${BIN_DIR}/cale;export;${FOLDER}/run;-o;${FOLDER}/policy.onnx"
        "${BIN_DIR}/cale;evaluate;${FOLDER}/run;--episodes;1;--out;${FOLDER}/evaluation"
        "${EMBED};${policy};100")
    execute_process(COMMAND ${command} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
    list(JOIN command " " text)
    message(STATUS "${text}\n${output}")
    if(NOT status EQUAL 0)
        message(FATAL_ERROR "failed: ${text}")
    endif()
endforeach()
