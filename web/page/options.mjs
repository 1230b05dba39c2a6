// What a visitor chose, and the link that carries it: #seed=3&speed=2&threshold=0.7
export const speeds = [0.25, 0.5, 1, 2, 4, 8];
const largestSeed = 0xffffffff;

/** The settings with a slider, by their names in `cale`. `unset`: what the slider's end stands for. */
export const sliders = [
    { name: 'threshold', label: 'threshold', min: 0, max: 0.99, step: 0.01, help: 'how far the stick must be pushed to count' },
    { name: 'sticky_probability', label: 'stickiness', min: 0, max: 0.95, step: 0.05, help: 'probability that a frame repeats the action before' },
    { name: 'action_latency', label: 'action latency', min: 0, max: 30, step: 1, unit: 'frames', help: 'frames until an action reaches the stick' },
    { name: 'observation_latency', label: 'view latency', min: 0, max: 30, step: 1, unit: 'frames', help: 'frames until the policy sees a screen' },
    { name: 'stick_speed', label: 'stick speed', min: 0.02, max: 0.52, step: 0.02, unit: 'r/frame', unset: 'none', unsetText: 'at once', help: 'radii per frame; at the right end the stick is at once where it is told to be' },
];

/** Returns {seed, speed, settings} of a link’s end. A seed or speed that cannot be is as by default; settings are checked
    where they are used. */
export function fromHash(hash) {
    const words = new URLSearchParams(hash.replace(/^#/, ''));
    const seed = Number(words.get('seed') || 1), speed = Number(words.get('speed') || 1);
    const settings = new Map();
    for (const { name } of sliders)
        if (words.has(name) && !/\s/.test(words.get(name))) settings.set(name, words.get(name));
    return {
        seed: Number.isInteger(seed) && seed >= 0 && seed <= largestSeed ? seed : 1,
        speed: speeds.includes(speed) ? speed : 1,
        settings,
    };
}

export function toHash({ seed, speed, settings }) {
    const words = new URLSearchParams({ seed });
    if (speed !== 1) words.set('speed', speed);
    for (const [name, value] of settings) words.set(name, value);
    return `#${words}`;
}

/** Returns the changed settings as Session.start() takes them. */
export function changes(settings) {
    return [...settings].map(([name, value]) => `${name}=${value}`).join('\n');
}
