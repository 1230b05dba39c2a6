// What the policy sees: its stack of frames, or of the console's memory as tiles, the oldest on the left.
import { palette } from './canvas.mjs';

const memoryBytes = 128;
const memoryColumns = 16;

/** Returns rows and columns of one part of the stack. */
function shape(info) {
    const memory = info.rows === 1;
    return memory ? { rows: Math.ceil(info.columns / memoryColumns), columns: memoryColumns, memory } : { ...info, memory };
}

/** Returns a sentence on it. */
export function observationText(info) {
    const joystick = info.columns > memoryBytes ? ` and ${info.columns - memoryBytes} of the joystick` : '';
    const what = info.rows === 1 ? `the console’s ${memoryBytes} bytes of memory${joystick}` : `${info.rows} × ${info.columns} grey frames`;
    const changed = info.rows === 1 ? '; bytes that changed since the one before are tinted' : '';
    return `The newest ${info.stack} of ${what}, one for each decision, the newest on the right${changed}.`;
}

export function drawObservation(canvas, bytes, info) {
    const { rows, columns, memory } = shape(info);
    const size = info.rows * info.columns;
    const gap = memory ? 1 : 2;
    canvas.width = info.stack * (columns + gap) - gap;
    canvas.height = rows;
    canvas.style.aspectRatio = `${canvas.width} / ${canvas.height}`;
    const context = canvas.getContext('2d');
    const [red, green, blue] = memory ? rgb(palette().policy) : [255, 255, 255];
    for (let part = 0; part < info.stack; ++part) {
        const image = context.createImageData(columns, rows);
        for (let i = 0; i < size; ++i) {
            const value = bytes[part * size + i];
            const changed = memory && part > 0 && value !== bytes[(part - 1) * size + i];
            const tint = changed ? [red / 255, green / 255, blue / 255] : [1, 1, 1];
            const brightness = changed ? Math.max(90, value) : value;
            image.data.set([brightness * tint[0], brightness * tint[1], brightness * tint[2], 255], 4 * i);
        }
        context.putImageData(image, part * (columns + gap), 0);
    }
}

function rgb(hex) {
    return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
}
