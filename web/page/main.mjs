// The page: loads the policy, takes the ROM, plays, and shows what is played.
import { drawDial, stickAt } from './dial.mjs';
import { fetchBytes, missingFeature, openSession } from './engine.mjs';
import { Hand, isUsed } from './hand.mjs';
import { events, position } from './joystick.mjs';
import { drawObservation, observationText } from './observation.mjs';
import { changes, fromHash, sliders, toHash } from './options.mjs';
import { Player } from './player.mjs';
import { Strip } from './strip.mjs';

const element = (id) => document.getElementById(id);
const policyFile = 'policy.safetensors';

let session, player, info;
let playing;  // the options of the game under way
let options = fromHash(location.hash);
let lives = 0;
let pointed = false;  // whether a pointer was used last, and not a key
const shown = new Map();  // by setting, what its slider says: before the game has it, while it is being moved
const hand = new Hand(showPlayer, () => session?.hasGame);
const strip = new Strip();

// Sentences ----------------------------------------------------------------------------

function say(sentence) {
    element('message').textContent = sentence;
    element('message').hidden = !sentence;
}

/** Asks for a file where the game would be. */
function invite(title, text) {
    enableControls(false);
    hand.giveBack();
    element('observation').hidden = true;
    for (const id of ['numbers', 'rate']) element(id).textContent = '';
    element('invitation').hidden = false;
    element('invitation-title').textContent = title;
    element('invitation-text').textContent = text;
    element('choose').hidden = !session;
}

// Playing ------------------------------------------------------------------------------

function enableControls(enabled) {
    for (const id of ['pause', 'step', 'restart', 'hand']) element(id).disabled = !enabled;
}

function begin() {
    player.start(changes(options.settings), options.seed);
    player.speed = options.speed;
    playing = { ...options, settings: new Map(options.settings) };
    strip.clear();
    lives = 0;
    element('last').textContent = '';
    hand.giveBack();
    element('invitation').hidden = true;
    enableControls(true);
    showFrame();
    showDecision();
}

/** Begins again where there is a game. Where that fails, says why, and what is shown is that of the game before. */
function restart() {
    say('');
    history.replaceState(null, '', toHash(options));
    if (!session?.hasRom) return;
    try {
        begin();
    } catch (error) {
        pause(true);
        say(`These settings cannot be played: ${error.message}.`);
        if (!session.hasGame) return;
        options = { ...playing, settings: new Map(playing.settings), speed: player.speed };
        history.replaceState(null, '', toHash(options));
        makeSliders();
    }
}

function pause(paused) {
    player.paused = paused;
    element('pause').textContent = paused ? 'Play' : 'Pause';
    element('pause').classList.toggle('on', paused);
}

function stepped(moment) {
    strip.add({ ...moment, lifeLost: moment.lives < lives });
    lives = moment.lives;
    if (moment.over) element('last').textContent = `game over with ${moment.episodeReturn} points`;
}

// Showing ------------------------------------------------------------------------------

function showFrame() {
    const width = session.screenWidth, height = session.screenHeight;
    const game = element('game');
    if (game.width !== width || game.height !== height) Object.assign(game, { width, height });
    const pixels = new Uint8ClampedArray(session.screen(player.frame));
    game.getContext('2d').putImageData(new ImageData(pixels, width, height), 0, 0);
}

function showDial() {
    const moment = player.moment;
    const paddle = session.trained('paddle') === 'absolute';
    const rest = { radius: 0, theta: 0, fire: 0 };
    const placed = player.paused && hand.taken;  // by hand, for the next step
    const commanded = placed ? hand.action() : moment?.commanded ?? rest;
    const gaussian = info.head === 'gaussian';
    const threshold = Number(shown.get('threshold'));
    const edges = session.trained('event_map') === 'ale_0_10' ? [threshold, threshold] : [-threshold, threshold];
    drawDial(element('dial'), {
        threshold,
        edges,
        paddle,
        commanded,
        stick: session.stick(player.frame),
        event: moment ? moment.seen[player.frame] : 0,
        byHand: moment ? moment.byHand : hand.taken,
        draws: moment && gaussian ? session.draws() : null,
        values: moment && !gaussian ? session.eventValues() : null,
        valueText: (value) => (info.head === 'values' ? value.toPrecision(3) : `${Math.round(100 * Math.exp(value))} %`),
    });
    const { radius, theta, fire } = commanded;
    const stick = paddle ? `position ${((position(commanded).x + 1) / 2).toFixed(2)}` : `r ${radius.toFixed(2)} · θ ${theta.toFixed(2)}`;
    const event = moment ? events[moment.seen[player.frame]].name : 'NOOP';
    element('numbers').textContent = `${stick} · fire ${fire.toFixed(2)}${placed ? '' : ` → ${event}`}`;
}

/** What changes with a decision and not with a frame. */
function showDecision() {
    element('observation').hidden = false;
    drawObservation(element('observation'), session.observation(), info);
    strip.draw(element('strip'));
    const moment = player.moment;
    element('return').textContent = moment?.episodeReturn ?? 0;
    element('lives').textContent = moment?.lives ?? '–';
    element('steps').textContent = moment?.steps ?? 0;
    showDial();
}

function showPlayer() {
    element('player').textContent = hand.taken ? 'You play' : 'The policy plays';
    element('hand').textContent = hand.taken ? 'Give back' : 'Take over';
    element('hand').classList.toggle('on', hand.taken);
}

function showPolicy() {
    const density = {
        gaussian: 'Green dots: 600 draws of the policy’s Gaussian, on the disc and beside the button.',
        values: 'Green: the value of each zone with the better state of the button, and of that in the best zone.',
        'log-probabilities': 'Green: the probability of each zone with the likelier state of the button, and of that in the likeliest zone.',
    };
    element('title').textContent = `${info.game}, played by a joystick policy`;
    document.title = element('title').textContent;
    const trained = info.agentSteps ? `, ${Number(info.agentSteps).toLocaleString('en')} agent steps` : '';
    element('subtitle').textContent =
        `${info.agent}${info.encoder ? ` with ${info.encoder}` : ''}${trained}, on the Continuous Arcade Learning Environment`;
    element('density').textContent = density[info.head];
    element('observation-text').textContent = observationText(info);
}

function showGamepad(gamepad) {
    element('gamepad').textContent = gamepad
        ? `Gamepad: ${gamepad.id}. Its left stick takes over, Start gives back.`
        : typeof navigator.getGamepads === 'function'
            ? 'No gamepad is connected: press a button on one to use its analog stick.'
            : 'This browser gives this page no gamepads; most give them to https:// and localhost alone.';
}

let countedFrom = 0, countedFrames = 0;
function showRate(now) {
    if (now - countedFrom < 1000) return;
    const rate = (player.played - countedFrames) / (now - countedFrom) * 1000;
    element('rate').textContent = player.paused ? 'paused' : `${Math.round(rate)} frames/s`;
    [countedFrom, countedFrames] = [now, player.played];
}

/** Returns what `play` returns. Where the game cannot continue, the page says so. */
function attempt(play) {
    try {
        return play();
    } catch (error) {
        pause(true);
        return say(`The game cannot continue: ${error.message}.`);
    }
}

/**
 * Returns the gamepad that was used last, or else the first; null where there is none, or a page around this one does
 * not allow it.
 */
function usedGamepad() {
    let pads;
    try {
        pads = [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad);
    } catch {
        return null;
    }
    const used = pads.find(isUsed) ?? pads.find(({ index }) => index === gamepadUsed) ?? pads[0] ?? null;
    gamepadUsed = used?.index;
    return used;
}

let gamepadUsed, gamepadShown;
function repaint(now) {
    requestAnimationFrame(repaint);
    const gamepad = usedGamepad();
    hand.poll(gamepad);
    if (gamepad?.id !== gamepadShown) showGamepad(gamepad);
    gamepadShown = gamepad?.id;
    if (!session.hasGame) return;
    showRate(now);
    const before = player.moment?.steps;
    if (player.paused && hand.taken) showDial();
    if (!attempt(() => player.advance(now))) return;
    showFrame();
    if (player.moment.steps === before) showDial();
    else showDecision();
}

// Files --------------------------------------------------------------------------------

function usePolicy(bytes, name) {
    session.loadPolicy(bytes, name);
    info = session.info();
    showPolicy();
    makeSliders();
    if (session.hasRom) return restart();
    invite(`Drop the ROM of ${info.game.replaceAll('+', ' or ')} here`,
        'or choose its file. It stays in this browser; none comes with the page. Any cale policy file can be dropped, too.');
}

async function take(file) {
    if (!session || !file) return;
    say('');
    try {
        const bytes = new Uint8Array(await file.arrayBuffer());
        if (file.name.endsWith('.safetensors')) return usePolicy(bytes, file.name);
        session.insertRom(bytes);
        pause(false);
        restart();
    } catch (error) {
        const named = error.message.includes(file.name) ? '' : `${file.name}: `;
        say(`${named}${error.message}.`);
    }
}

function acceptFiles() {
    const drop = element('drop');
    const over = (event) => {
        event.preventDefault();
        drop.classList.toggle('dragging', event.type === 'dragover');
    };
    for (const type of ['dragover', 'dragleave', 'drop']) document.addEventListener(type, over);
    document.addEventListener('drop', (event) => take(event.dataTransfer.files[0]));
    element('file').addEventListener('change', (event) => {
        take(event.target.files[0]);
        event.target.value = '';
    });
}

// Controls -----------------------------------------------------------------------------

function sliderText({ unit, unset, unsetText }, value) {
    if (value === unset) return unsetText;
    return unit ? `${value} ${unit}` : value;
}

/** A slider for each setting, at what the policy was trained with where the link says nothing else. */
function makeSliders() {
    element('sliders').replaceChildren(...sliders.map((slider) => {
        const now = options.settings.get(slider.name) ?? session.trained(slider.name);
        const row = document.createElement('label');
        row.className = 'slider';
        row.title = slider.help;
        const name = document.createElement('span');
        name.textContent = slider.label;
        const input = document.createElement('input');
        Object.assign(input, { type: 'range', id: `slider-${slider.name}`, min: slider.min, max: slider.max, step: slider.step });
        // Of a range such as 0-8 the slider stands at its end.
        input.value = now === slider.unset ? slider.max : String(now).split('-').pop();
        const output = document.createElement('output');
        const showValue = (value) => {
            output.textContent = sliderText(slider, value);
            input.setAttribute('aria-valuetext', output.textContent);
        };
        showValue(now);
        shown.set(slider.name, now);
        const chosen = () => (slider.unset && input.value === input.max ? slider.unset : String(Number(input.value)));
        input.addEventListener('input', () => {
            showValue(chosen());
            shown.set(slider.name, chosen());
            if (session.hasGame) showDial();
        });
        input.addEventListener('change', () => {
            options.settings.set(slider.name, chosen());
            restart();
        });
        row.append(name, input, output);
        return row;
    }));
    element('seed').value = options.seed;
    element('speed').value = String(options.speed);
}

function connectButtons() {
    // What a pointer has used must not take the keys that play: a button the space bar, a slider the arrows.
    document.addEventListener('pointerup', () => {
        if (document.activeElement?.matches('button, input[type=range]')) document.activeElement.blur();
    });
    document.addEventListener('pointerdown', () => (pointed = true));
    document.addEventListener('keydown', () => (pointed = false), true);
    element('pause').addEventListener('click', () => pause(!player.paused));
    element('step').addEventListener('click', oneStep);
    element('restart').addEventListener('click', restart);
    element('hand').addEventListener('click', () => (hand.taken ? hand.giveBack() : hand.take()));
    element('speed').addEventListener('change', (event) => {
        if (pointed) event.target.blur();
        options.speed = player.speed = Number(event.target.value);
        history.replaceState(null, '', toHash(options));
    });
    element('seed').addEventListener('change', (event) => {
        options.seed = fromHash(`seed=${event.target.value}`).seed;
        event.target.value = options.seed;
        restart();
    });
    element('as-trained').addEventListener('click', () => {
        options.settings.clear();
        makeSliders();
        restart();
    });
    element('link').addEventListener('click', copyLink);
    element('open').addEventListener('click', () => element('file').click());
    element('theme').addEventListener('click', switchTheme);
    window.addEventListener('hashchange', () => {
        options = fromHash(location.hash);
        makeSliders();
        restart();
    });
}

function oneStep() {
    if (!session.hasGame) return;
    pause(true);
    attempt(() => {
        player.step();
        showFrame();
        showDecision();
    });
}

async function copyLink() {
    history.replaceState(null, '', toHash(options));
    try {
        await navigator.clipboard.writeText(location.href);
        say('The link is copied. It carries the seed, the speed and the settings, not the ROM.');
    } catch {
        say(`This browser copies no links for this page: it stands in the address bar, ${location.href}`);
    }
}

function switchTheme() {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
    if (session?.hasGame) showDecision();
}

function connectHand() {
    const dial = element('dial'), fire = element('fire');
    const point = (event) => {
        const box = dial.getBoundingClientRect();
        const { x, y } = stickAt(dial, event.clientX - box.left, event.clientY - box.top);
        hand.point(x, y);
    };
    dial.addEventListener('contextmenu', (event) => event.preventDefault());
    dial.addEventListener('pointerdown', (event) => {
        dial.setPointerCapture(event.pointerId);
        if (event.button === 2) hand.pointerFires(true);
        else point(event);
    });
    dial.addEventListener('pointermove', (event) => {
        if (event.buttons & 1) point(event);
        if (event.pointerType === 'touch' || !event.buttons) return;
        if (!(event.buttons & 1)) hand.point();
        hand.pointerFires(Boolean(event.buttons & 2));
    });
    for (const type of ['pointerup', 'pointercancel']) {
        dial.addEventListener(type, (event) => {
            hand.point();
            // Another finger may hold the button beside the dial.
            if (event.pointerType !== 'touch') hand.pointerFires(false);
        });
    }
    const press = (down) => {
        hand.pointerFires(down);
        fire.toggleAttribute('data-down', down);
    };
    fire.addEventListener('pointerdown', (event) => {
        fire.setPointerCapture(event.pointerId);
        press(true);
    });
    fire.addEventListener('pointerup', () => press(false));
    fire.addEventListener('pointercancel', () => press(false));
    fire.addEventListener('click', (event) => {
        if (event.detail > 0) return;  // a pointer's
        press(true);
        setTimeout(() => press(false), 100);
    });
    window.addEventListener('blur', () => hand.release());
}

function connectKeys() {
    const commands = {
        KeyP: () => pause(!player.paused), KeyN: oneStep, KeyR: restart, KeyG: () => hand.giveBack(), Escape: () => hand.giveBack(),
    };
    const press = (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || !session?.hasGame) return;
        // Fields, and buttons with the space bar, keep their keys, but for the one that fires.
        if (event.target.closest('input, select, summary')) return;
        if (event.code === 'Space' && event.target.closest('button:not(#fire)')) return;
        if (!event.repeat && commands[event.code]) return commands[event.code]();
        if (hand.key(event.code, true, event.repeat)) event.preventDefault();
    };
    document.addEventListener('keydown', press);
    // Wherever and with whatever other keys: what is not let go of stays pressed.
    document.addEventListener('keyup', (event) => {
        hand.key(event.code, false);
        if (event.key === 'Meta') hand.release();  // macOS says nothing of keys that were released meanwhile
    });
}

async function main() {
    element('needs-server').remove();
    const missing = missingFeature();
    if (missing) {
        invite('This page cannot play here', '');
        return say(missing);
    }
    session = await openSession();
    player = new Player(session, hand, stepped);
    player.speed = options.speed;
    acceptFiles();
    connectButtons();
    connectHand();
    connectKeys();
    showGamepad(null);
    const redraw = () => {
        if (session.hasGame) showDecision();
    };
    window.addEventListener('resize', redraw);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
    requestAnimationFrame(repaint);
    try {
        const policy = await fetchBytes(policyFile);
        if (!info) usePolicy(policy, policyFile);  // unless one was dropped meanwhile
    } catch (error) {
        if (info) return;
        say(`${error.message}.`);
        invite('No policy could be loaded', 'Drop a policy file, NAME.safetensors, or choose one.');
    }
}

main().catch((error) => say(`The page could not start: ${error.message}.`));
