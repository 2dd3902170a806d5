// Changes of the models' MJCF.

/** A ball that is free to move: a position and a quaternion come into qpos, before everything after it. */
const BALL = `
    <body name="ball" pos="-0.4 0 1.3">
      <freejoint name="ball"/>
      <geom name="ball" type="sphere" size="0.07" mass="0.1"/>
    </body>`;
const BALL_QPOS = "-0.4 0 1.3 1 0 0 0";

/**
 * Return the cart-pole with a ball before it. Its keyframe grows by the ball's seven numbers: a keyframe is an
 * array that is indexed, too, and a model whose keyframe has another size than its qpos does not compile.
 * @param {string} xml models/cartpole.xml
 * @returns {string}
 */
export function withBallFirst(xml) {
  return xml.replace("<worldbody>", `<worldbody>${BALL}`).replace('qpos="', `qpos="${BALL_QPOS} `);
}
