# SPDX-License-Identifier: Apache-2.0
import array
import io

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from live_stage import Stage
from PIL import Image
from programs import until
from sensor_msgs.msg import CompressedImage
from std_srvs.srv import Trigger

from soliton_linkage_nodes.runtime import interfaces

RED, BLUE = (230, 20, 20), (20, 20, 230)
PIXEL = """([x, y]) => {
  const { element } = live.camera.canvas;
  const c = new OffscreenCanvas(element.width, element.height).getContext('2d');
  c.drawImage(element, 0, 0);
  return [...c.getImageData(x, y, 1, 1).data].slice(0, 3);
}"""


class Camera:
    """Publisher of a picture with a red and a blue half, while it has a subscriber."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._user = stage.user
        self.data = picture()
        self.publisher = interfaces.CAMERA_OVERLAY.publisher(self._user)
        self._timer = self._user.create_timer(0.1, self._publish)

    def close(self) -> None:
        self._stage.end(self._timer, self.publisher)

    def _publish(self) -> None:
        if self.data and self.publisher.get_subscription_count():
            data = array.array('B', self.data)
            self.publisher.publish(CompressedImage(format='jpeg', data=data))


def picture() -> bytes:
    halves = Image.new('RGB', (320, 180), RED)
    halves.paste(BLUE, (160, 0, 320, 180))
    written = io.BytesIO()
    halves.save(written, 'jpeg')
    return written.getvalue()


@pytest.fixture
def camera(visit, stage):
    made = Camera(stage)
    yield made
    made.close()


def test_a_chain_without_a_camera_shows_the_reason(visit):
    visit.load()  # a page that has shown a picture keeps it
    visit.has_text('camera-figure', 'no node publishes camera_overlay; start camera_encoders')
    assert 'absent' in visit.page.locator('#live-camera-figure').get_attribute('class')
    assert not visit.page.locator('#live-camera').is_visible()


def test_camera_pictures_are_shown_while_the_panel_is_open(visit, camera):
    visit.has_text('camera-figure', '320 × 180, ')
    for place, colour in (((40, 90), RED), ((280, 90), BLUE)):
        assert visit.page.evaluate(PIXEL, place) == pytest.approx(colour, abs=12)
    for size in ((390, 844), (1400, 900)):
        visit.resize(*size)
        shown = visit.page.locator('#live-camera').bounding_box()
        assert shown['width'] / shown['height'] == pytest.approx(320 / 180, rel=0.02)
    box = visit.page.locator('#live-camera-figure summary')
    box.click()
    until(lambda: camera.publisher.get_subscription_count() == 0, 'the end of the subscription')
    box.click()
    until(camera.publisher.get_subscription_count, 'the subscription')
    visit.wait('live.camera.count > 1')
    camera.data = b''
    visit.has_text('camera-figure', 'no picture for ')
    assert 'stopped' in visit.page.locator('#live-camera-figure').get_attribute('class')
    camera.data = b'no picture'
    visit.has_text('camera-figure', "10 bytes of format 'jpeg' are no JPEG")
    camera.data = b'\xff\xd8\xff and so on'
    visit.has_text('camera-figure', 'the browser cannot decode the picture')
    camera.data = picture()
    visit.wait('!live.camera.error && live.camera.count > 1')
    visit.wait('!document.getElementById("live-camera-figure").classList.contains("stopped")')


class Identifier:
    """Services and reports of a chain identifier."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._user = stage.user
        self.requested: list[str] = []
        self._reports = interfaces.DIAGNOSTICS.publisher(self._user)
        self._services = [
            self._user.create_service(
                Trigger,
                f'chain_identifier/{name}',
                lambda _, answer, n=name: self._respond(n, answer),
            )
            for name in ('identify', 'save', 'forget')
        ]
        self._figures: dict[str, str] = {}
        self._message = 'waiting for a soliton to pass'
        self._timer = self._user.create_timer(0.2, self._report)

    def set_report(self, message: str, **figures: str) -> None:
        self._message = message
        self._figures = {name.replace('_', ' '): value for name, value in figures.items()}

    def close(self) -> None:
        self._stage.end(self._timer, self._reports, *self._services)

    def _respond(self, name: str, answer: Trigger.Response) -> Trigger.Response:
        self.requested.append(name)
        answer.success, answer.message = name != 'forget', f'{name} received'
        return answer

    def _report(self) -> None:
        values = [KeyValue(key=key, value=value) for key, value in self._figures.items()]
        status = DiagnosticStatus(
            name='/chain_identifier: identification',
            hardware_id='/chain_identifier',
            message=self._message,
            values=values,
        )
        self._reports.publish(DiagnosticArray(status=[status]))


def test_the_buttons_identify_and_save_the_chain(visit, stage):
    visit.tab('Identify')
    visit.panel_has_text('no node serves identify; start chain_identifier')
    assert visit.page.locator('#live-identifier-identify').is_disabled()
    identifier = Identifier(stage)
    visit.page.locator('#live-identifier-identify:enabled').click()
    visit.answers('identify received')
    # The identification began before the page was opened.
    begun = {'identifying for [s]': '300.0'}
    identifier.set_report('waiting', frames='900', identifying='True', **begun)
    visit.has_text('identified', '900 frames, identifying for 30')
    assert visit.page.locator('#live-identifying').is_visible()
    found = {'noise [rad]': '0.0101', 'tolerance': '0.05', 'worst_bonds': '3, 7, 1'}
    identifier.set_report('a flipper of 12 rotors; bond 7 will stop a wall', frames='950', **found)
    visit.has_text('identified', 'a flipper of 12 rotors\nbond 7 will stop a wall')
    visit.has_text('identified', 'least accurate springs or bars: 3, 7, 1')
    visit.has_text('identified', 'noise of the angles: 0.01 rad')
    visit.has_text('identified', 'standard deviation of lengths of one kind: 5 %')
    visit.page.locator('#live-identifying').wait_for(state='hidden')
    visit.click('identifier-save')
    visit.answers('save received')
    visit.click('identifier-forget')
    visit.answers('forget received')
    assert identifier.requested == ['identify', 'save', 'forget']
    identifier.close()
    visit.panel_has_text('no node serves identify; start chain_identifier')
    visit.tab('Drive')
