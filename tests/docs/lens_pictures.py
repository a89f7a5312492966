"""Write pictures of a checkerboard, board0.png to board4.png, as a user takes them of a printed one."""

from boat_daq.engine.simulator.picture import CameraScene
from protocol.base.optional import optional
from tests.boat_daq.engine.simulator.checkerboard import checkerboard

if __name__ == "__main__":
    for number, tilt in enumerate((-20.0, -10.0, 0.0, 10.0, 20.0)):
        optional("cv2").imwrite(f"board{number}.png", checkerboard(CameraScene(), tilt))
