import type { State, Instant } from "./types";
declare global {
    interface Window {
        p3dof: { ready: Promise<unknown>; state: State; instant(): Instant; seek(time: number): void; [other: string]: any };
    }
}
