// The camera: standard views, perspective or parallel, and how far away it must be to see all.
import { OrthographicCamera, PerspectiveCamera, Vector3 } from "three";

/** Opening of the perspective camera, upward [degrees]: a long lens distorts little. */
const OPENING = 35;
const TANGENT = Math.tan((OPENING * Math.PI) / 360);
/** Room that is left around what is seen [pixels]: left, right, top, bottom. */
/** @typedef {[number, number, number, number]} Margins */

/** From what is looked at to the eye, in the fixed frame. */
export const DIRECTIONS = {
    "3d": [0.85, -0.45, 0.36], // as pictures of the package are taken
    front: [1, 0, 0],
    side: [0, -1, 0],
    top: [1e-4, 0, 1], // y to the right, as in front
};

/** Two cameras of which one is used; distances are in radii of the scene. */
export class Cameras {
    constructor() {
        this.perspective = new PerspectiveCamera(OPENING, 1, 0.02, 60);
        this.parallel = new OrthographicCamera(-1, 1, 1, -1, 0.02, 60);
        for (const camera of [this.perspective, this.parallel]) camera.up.set(0, 0, 1);
        /** @type {PerspectiveCamera | OrthographicCamera} */
        this.used = this.perspective;
        this.aspect = 1;
    }

    /** @param {number} width @param {number} height */
    resize(width, height) {
        this.aspect = width / height;
        this.perspective.aspect = this.aspect;
        this.perspective.updateProjectionMatrix();
        this._widen(this.parallel.top);
    }

    /** Use the other camera from the same place. @param {boolean} parallel @param {Vector3} target */
    use(parallel, target) {
        const next = parallel ? this.parallel : this.perspective;
        if (next === this.used) return false;
        const away = this.used.position.clone().sub(target);
        next.position.copy(this.used.position);
        if (parallel) {
            this.parallel.zoom = 1;
            this._widen(away.length() * TANGENT);
        } else {
            next.position.copy(target).addScaledVector(away.normalize(), this.parallel.top / this.parallel.zoom / TANGENT);
        }
        next.lookAt(target);
        next.updateMatrixWorld();
        this.used = next;
        return true;
    }

    /**
     * Look from a direction so that all points are just in the picture.
     * @param {Vector3[]} points @param {Vector3} direction from them to the eye @param {Vector3} target changed to what is looked at
     * @param {Margins} margins as shares of half the picture's width or height
     */
    fit(points, direction, target, margins) {
        const eye = direction.clone().normalize();
        const right = new Vector3(0, 0, 1).cross(eye).normalize();
        const up = eye.clone().cross(right);
        const straight = this.used === this.parallel;
        const sides = [right.clone().negate(), right, up, up.clone().negate()];
        const slopes = margins.map((margin, i) => TANGENT * (i < 2 ? this.aspect : 1) * Math.max(1 - margin, 0.1));
        const reach = sides.map((side, i) =>
            points.reduce((most, point) => Math.max(most, point.dot(side) + (straight ? 0 : point.dot(eye) * slopes[i])), -Infinity));
        const distance = Math.max((reach[0] + reach[1]) / (slopes[0] + slopes[1]), (reach[2] + reach[3]) / (slopes[2] + slopes[3]));
        /** Half way between how far to one side the eye may go and how far to the other. @param {number} i @param {number} j */
        const middle = (i, j) => (reach[j] - distance * slopes[j] + distance * slopes[i] - reach[i]) / 2;
        target.set(0, 0, 0).addScaledVector(right, middle(0, 1)).addScaledVector(up, middle(3, 2));
        this.used.position.copy(target).addScaledVector(eye, straight ? 4 : distance);
        if (straight) {
            this.parallel.zoom = 1;
            this._widen(distance * TANGENT);
        }
        this.used.lookAt(target);
        this.used.updateMatrixWorld();
    }

    /** @param {number} half height of what the parallel camera sees */
    _widen(half) {
        const camera = this.parallel;
        [camera.top, camera.bottom] = [half, -half];
        [camera.left, camera.right] = [-half * this.aspect, half * this.aspect];
        camera.updateProjectionMatrix();
    }
}
