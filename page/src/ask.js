// An engine that asks Python: for machines that the page cannot compute by itself.
import { instant } from "./instant.js";

/** @typedef {import("./types").State} State */
/** @typedef {{q?: Float64Array, pose?: number[], values: Record<string, number>, loads: Record<string, number[]>, refused?: string}} Answer */

export class AskEngine {
    /** @param {{ask(question: object): Promise<any>, open: boolean}} connection @param {State} state */
    constructor(connection, state) {
        this.connection = connection;
        this.state = state;
        this.kind = "ask";
        /** @type {object | null} what is to be asked when the answer that is waited for is here */
        this.next = null;
        this.busy = false;
        /** @type {{hand: object, held: Answer} | null} */
        this.latest = null;
    }

    /** What Python said of where the machine is held. @param {object} hand @returns {Answer | undefined} */
    held(hand) {
        return this.latest?.hand === hand ? this.latest.held : undefined;
    }

    /**
     * Move to values of the inputs, or to a pose: the machine follows when Python has answered.
     * @param {{inputs: Record<string, number>} | {pose: number[]}} goal
     */
    move(goal) {
        this.next = { ...goal, q: Array.from(instant(this.state).q) };
        if (!this.busy) void this.go();
    }

    async go() {
        this.busy = true;
        while (this.next) {
            const question = this.next;
            this.next = null;
            this.take(await this.connection.ask(question));
        }
        this.busy = false;
    }

    /** @param {any} answer */
    take(answer) {
        if (answer.refused) {
            this.state.set({ refused: { text: answer.refused, legs: answer.legs ?? [] } });
            return;
        }
        const q = new Float64Array(answer.q.bytes.buffer);
        const hand = answer.pose ? { pose: answer.pose } : { q: Array.from(q) };
        this.latest = { hand, held: { q, pose: answer.pose, values: answer.values ?? {}, loads: answer.loads ?? {} } };
        this.state.set({ hand, refused: null, playing: false });
    }
}
