import rclpy, time, sys
from rclpy.experimental import EventsExecutor
from std_srvs.srv import SetBool
from diagnostic_msgs.msg import DiagnosticArray
rclpy.init()
n=rclpy.create_node('probe'); ex=EventsExecutor(); ex.add_node(n)
n.create_subscription(DiagnosticArray,'/diagnostics',lambda m: print('%.2f'%(time.monotonic()-t0), m.status[0].message, [v.value for v in m.status[0].values][:6]),10)
c=n.create_client(SetBool,'/simulator/pause')
t0=time.monotonic()
while time.monotonic()-t0<5: ex.spin_once(timeout_sec=.1)
f=c.call_async(SetBool.Request(data=True)); t1=time.monotonic()
while not f.done() and time.monotonic()-t1<20: ex.spin_once(timeout_sec=.1)
print('pause answered after',time.monotonic()-t1, f.done())
