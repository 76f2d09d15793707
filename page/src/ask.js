// An engine that asks Python: for machines that the page cannot compute by itself.
import { instant } from "./instant.js";

/** @typedef {import("./types").State} State */
/**
 * What Python said of where a machine is held.
 * @typedef {object} Answer
 * @property {Float64Array} q
 * @property {number[]} [pose]
 * @property {Record<string, number>} values of the curves, by key
 * @property {Record<string, number[]>} loads vectors, by key
 * @property {string[]} notes
 */

export class AskEngine {
    /** @param {{ask(question: object): Promise<any>, open: boolean}} connection @param {State} state */
    constructor(connection, state) {
        this.connection = connection;
        this.state = state;
        this.kind = "ask";
        /** @type {object | null} what is to be asked when the answer that is waited for is here */
        this.next = null;
        this.busy = false;
        /** @type {{hand: object, asked: any, held: Answer} | null} */
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
            this.take(await this.connection.ask(question), question);
        }
        this.busy = false;
    }

    /** @param {any} answer @param {object} asked */
    take(answer, asked) {
        if (answer.refused) {
            this.state.set({ refused: { text: answer.refused, legs: answer.legs ?? [] } });
            return;
        }
        const q = new Float64Array(answer.q.bytes.buffer);
        const hand = answer.pose ? { pose: answer.pose } : { q: Array.from(q) };
        const { pose, values = {}, loads = {}, notes = [] } = answer;
        this.latest = { hand, asked, held: { q, pose, values, loads, notes } };
        this.state.set({ hand, playing: false });
    }
}
