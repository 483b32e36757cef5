<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>Convergence</name>
    <message>
        <source>Sigma as a multiple of its target</source>
        <extracomment>Points kept per line; beyond that every other one is dropped. Least span of the time axis, min. Host time between two drawings, s.</extracomment>
        <translation>标准差与目标值之比</translation>
    </message>
    <message>
        <source>device time, min</source>
        <translation>设备时间，min</translation>
    </message>
    <message>
        <source>target</source>
        <translation>目标</translation>
    </message>
    <message>
        <source>{group} {value} reached</source>
        <translation>{group} {value} 已达标</translation>
    </message>
</context>
<context>
    <name>Loading</name>
    <message>
        <source>Load the unit</source>
        <translation>装上产品</translation>
    </message>
    <message>
        <source>The unit is in its fixture</source>
        <translation>产品已在夹具上</translation>
    </message>
    <message>
        <source>A serial number is filled in</source>
        <translation>序列号已经填好</translation>
    </message>
    <message>
        <source>The unit is on its rails</source>
        <translation>产品已装在导轨架上</translation>
    </message>
    <message>
        <source>This station is the virtual bench: unit, rails and operator are simulated.</source>
        <translation>本工位是虚拟台架：产品、导轨和操作员均为模拟。</translation>
    </message>
    <message>
        <source>Press START</source>
        <translation>按“开始全参数标定”</translation>
    </message>
    <message>
        <source>The simulated operator turns the rails from position to position.</source>
        <translation>模拟操作员会逐个位置转动导轨，您不用动手。</translation>
    </message>
    <message>
        <source>Watch</source>
        <translation>观察即可</translation>
    </message>
    <message>
        <source>Fix the unit to the inner rail</source>
        <translation>把产品固定在内导轨上</translation>
    </message>
    <message>
        <source>Plug in its cable, both rails at 0°</source>
        <translation>插好电缆，两条导轨都在 0°</translation>
    </message>
    <message>
        <source>Press START and let go</source>
        <translation>按“开始全参数标定”，然后松手</translation>
    </message>
    <message>
        <source>It must reach through whole turns of both rails.</source>
        <translation>电缆长度要够两条导轨各转一整圈。</translation>
    </message>
    <message>
        <source>The scanner&apos;s Enter checks the number and moves on to START; a click or Space starts.</source>
        <translation>扫码枪的回车只核对序列号并跳到开始按钮；点击或按空格键才启动。</translation>
    </message>
    <message>
        <source>The screen then asks for one position after another; STOP or Esc end it at any time.</source>
        <translation>随后屏幕逐个提示位置；随时可按“停止”或 Esc 结束。</translation>
    </message>
    <message>
        <source>Any other number of the product&apos;s pattern is another unit.</source>
        <translation>换成符合产品规则的其他序列号，就是另一台产品。</translation>
    </message>
    <message>
        <source>This station is the virtual bench: table and unit are simulated, nothing moves.</source>
        <translation>本工位是虚拟台架：转台和产品均为模拟，设备不会实际运动。</translation>
    </message>
    <message>
        <source>The whole calibration takes about a minute here.</source>
        <translation>在这里做完全部标定大约一分钟。</translation>
    </message>
    <message>
        <source>STOP works at any time, and so does the Esc key.</source>
        <translation>任何时候都可以按“停止”，或按 Esc 键。</translation>
    </message>
    <message>
        <source>Fix the unit in the fixture</source>
        <translation>把产品固定在夹具上</translation>
    </message>
    <message>
        <source>Plug in its cable</source>
        <translation>接好电缆</translation>
    </message>
    <message>
        <source>Scan its serial number</source>
        <translation>扫描产品序列号</translation>
    </message>
    <message>
        <source>Stand clear, then press START</source>
        <translation>人离开转台，再按“开始全参数标定”</translation>
    </message>
    <message>
        <source>x to the right, y to the front, z up, as in the picture; screws tight.</source>
        <translation>x 向右、y 向前、z 向上，如图所示；螺钉拧紧。</translation>
    </message>
    <message>
        <source>It must not catch when the table turns.</source>
        <translation>转台转动时不能被挂住。</translation>
    </message>
</context>
<context>
    <name>OperatorPage</name>
    <message>
        <source>Operator</source>
        <extracomment>Steps of the progress bar.</extracomment>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Enter does not start: press Space or click START.</source>
        <translation>回车不会启动：请按空格键或点击“开始全参数标定”。</translation>
    </message>
    <message>
        <source>This station and product cannot run</source>
        <translation>这个工位和产品无法标定</translation>
    </message>
    <message>
        <source>Open the station page</source>
        <translation>打开工位页</translation>
    </message>
    <message>
        <source>Not the whole calibration of this product</source>
        <translation>不是这个产品的全部标定</translation>
    </message>
    <message>
        <source>As chosen on the Engineer page: {stages}.</source>
        <translation>按工程师页的选择：{stages}。</translation>
    </message>
    <message>
        <source>Whole calibration</source>
        <translation>全部标定</translation>
    </message>
    <message>
        <source>Stopping safely, then closing</source>
        <translation>正在安全停止，然后关闭</translation>
    </message>
    <message>
        <source>The table comes to rest first.</source>
        <translation>先等转台停稳。</translation>
    </message>
    <message>
        <source>Close now</source>
        <translation>立即关闭</translation>
    </message>
    <message>
        <source>Registers are being written</source>
        <translation>正在写寄存器</translation>
    </message>
    <message>
        <source>A calibration is in progress</source>
        <translation>正在标定</translation>
    </message>
    <message>
        <source>Closing stops the table safely; a write in progress is completed first.</source>
        <translation>关闭会让转台安全停下；正在写入的寄存器会先写完。</translation>
    </message>
    <message>
        <source>Closing stops the table safely; the run can be resumed later.</source>
        <translation>关闭会让转台安全停下，以后可以接着做。</translation>
    </message>
    <message>
        <source>Paused. Resume repeats the current position.</source>
        <translation>已暂停。继续后重新做当前位置。</translation>
    </message>
    <message>
        <source>Paused; the table is at rest. Resume repeats the current step.</source>
        <translation>已暂停，转台静止。继续时会重做当前这一步。</translation>
    </message>
    <message>
        <source>Stop and close</source>
        <translation>停止并关闭</translation>
    </message>
    <message>
        <source>Continue</source>
        <translation>继续</translation>
    </message>
    <message>
        <source>Read the fault and press Understood first.</source>
        <translation>请先看故障，再按“知道了”。</translation>
    </message>
    <message>
        <source>The table is coming to rest.</source>
        <translation>转台正在停稳。</translation>
    </message>
    <message>
        <source>The run is stopping.</source>
        <translation>正在停止。</translation>
    </message>
    <message>
        <source>Nothing is running.</source>
        <translation>没有在标定。</translation>
    </message>
    <message>
        <source>Registers are being written.</source>
        <translation>正在写寄存器。</translation>
    </message>
    <message>
        <source>The run can be paused once its first stage has started.</source>
        <translation>第一个阶段开始以后才能暂停。</translation>
    </message>
    <message>
        <source>Load a unit, scan its serial number, press START.</source>
        <translation>装上产品，扫描序列号，按“开始全参数标定”。</translation>
    </message>
    <message>
        <source>Starting the engine and connecting.</source>
        <translation>正在启动标定程序并连接设备。</translation>
    </message>
    <message>
        <source>Stopping.</source>
        <translation>正在停止。</translation>
    </message>
    <message>
        <source>Stopping safely: the table comes to rest, then its axes are switched off.</source>
        <translation>正在安全停止：转台先停稳，再断开轴使能。</translation>
    </message>
</context>
<context>
    <name>PositionPanel</name>
    <message>
        <source>Enough positions: finish</source>
        <extracomment>Text sizes, px, legible from two metres; a third larger on a wide panel. Least turn of a rail that is asked for, rad.</extracomment>
        <translation>位置已够，结束采集</translation>
    </message>
    <message>
        <source>All positions done</source>
        <translation>全部位置已完成</translation>
    </message>
    <message>
        <source>Leave the unit alone while the results are computed and checked.</source>
        <translation>正在解算和检查结果，请勿触碰产品。</translation>
    </message>
    <message>
        <source>Wait</source>
        <translation>请稍候</translation>
    </message>
    <message>
        <source>Leave the unit alone until the first position is asked for.</source>
        <translation>提示第一个位置之前，请勿触碰产品。</translation>
    </message>
    <message>
        <source>Waiting</source>
        <translation>等待中</translation>
    </message>
    <message>
        <source>Moving</source>
        <translation>转动中</translation>
    </message>
    <message>
        <source>Hold still</source>
        <translation>保持静止</translation>
    </message>
    <message>
        <source>Enough: go on</source>
        <translation>已够，请继续</translation>
    </message>
    <message>
        <source>Too soon: repeat</source>
        <translation>动得太早，再来一次</translation>
    </message>
    <message>
        <source>It was moved too soon. Let go, and leave it for {seconds:.0f} s.</source>
        <translation>静止时间不够就动了。请松手，静置 {seconds:.0f} 秒。</translation>
    </message>
    <message>
        <source>The registers are written; these two rests verify them.</source>
        <translation>寄存器已写入，用这两次静止来验证。</translation>
    </message>
    <message>
        <source>The positions done are sufficient; more improve the accuracy.</source>
        <translation>已完成的位置分布充分，足以解算；再多做几个会更准。</translation>
    </message>
    <message>
        <source>Rings on the globe are still to do; turn the large one to the mark at the top.</source>
        <translation>球面上的空心圈是还没做的位置；把大圈转到顶部的标记处。</translation>
    </message>
    <message>
        <source>Not yet: the positions done are not sufficient.</source>
        <translation>还不行：已完成的位置分布不够充分。</translation>
    </message>
    <message>
        <source>Hands off. {seconds:.0f} s left.</source>
        <translation>请勿触碰，还剩 {seconds:.0f} 秒。</translation>
    </message>
    <message>
        <source>Turn the outer rail to about {outer} and the inner rail to about {inner}, then let go.</source>
        <translation>把外导轨转到约 {outer}、内导轨转到约 {inner}，然后松手。</translation>
    </message>
    <message>
        <source>Turn the outer rail to about {outer}, then let go.</source>
        <translation>把外导轨转到约 {outer}，然后松手。</translation>
    </message>
    <message>
        <source>Turn the inner rail to about {inner}, then let go.</source>
        <translation>把内导轨转到约 {inner}，然后松手。</translation>
    </message>
    <message>
        <source>Leave it with the outer rail at {outer} and the inner rail at {inner}, hands off.</source>
        <translation>保持外导轨 {outer}、内导轨 {inner}，请勿触碰。</translation>
    </message>
    <message>
        <source>position {index} of {count}</source>
        <translation>第 {index} 个位置，共 {count} 个</translation>
    </message>
    <message>
        <source>check {index} of {count}</source>
        <translation>验证 {index}/{count}</translation>
    </message>
    <message>
        <source>Finishing: the positions done are being solved.</source>
        <translation>正在结束：用已完成的位置解算。</translation>
    </message>
</context>
<context>
    <name>PositionPicture</name>
    <message>
        <source>down</source>
        <extracomment>Half of the box along x, y, z; the globe&apos;s radius is 1. Radius and width of the ring that fills while it rests. Opacity behind the unit. Opacity of the next position behind the unit. Cosine of the angle below which two positions are one dot.</extracomment>
        <translation>下</translation>
    </message>
</context>
<context>
    <name>Preparation</name>
    <message>
        <source>Preparing</source>
        <extracomment>Steps, by the message that starts each; the first starts with START. Message that ends the preparation of a register operation; the first stage ends that of a run. Messages that start a step on a manual rig, with the message of the step.</extracomment>
        <translation>准备</translation>
    </message>
    <message>
        <source>The table and the unit are identified.</source>
        <translation>识别转台和产品。</translation>
    </message>
    <message>
        <source>Gravity and two small turns show whether the unit is mounted correctly.</source>
        <translation>用重力和两次小角度转动检查产品安装是否正确。</translation>
    </message>
    <message>
        <source>The unit is identified.</source>
        <translation>识别产品。</translation>
    </message>
    <message>
        <source>The magnitude of gravity shows whether the unit measures correctly. Leave it alone.</source>
        <translation>用重力大小检查产品输出是否正常。请勿触碰。</translation>
    </message>
    <message>
        <source>Connecting</source>
        <translation>连接</translation>
    </message>
    <message>
        <source>Unit ready</source>
        <translation>产品就绪</translation>
    </message>
    <message>
        <source>Homing</source>
        <translation>回零</translation>
    </message>
    <message>
        <source>The table searches its reference slowly. Keep hands clear.</source>
        <translation>转台慢速寻找零位。手请离开。</translation>
    </message>
    <message>
        <source>Warm-up</source>
        <translation>预热</translation>
    </message>
    <message>
        <source>The unit reaches its operating temperature. Nothing to do.</source>
        <translation>产品达到工作温度，不用做什么。</translation>
    </message>
    <message>
        <source>Mounting</source>
        <translation>安装检查</translation>
    </message>
    <message>
        <source>Gravity</source>
        <translation>重力检查</translation>
    </message>
    <message>
        <source>The unit starts and tests itself.</source>
        <translation>产品启动并自检。</translation>
    </message>
</context>
<context>
    <name>Resuming</name>
    <message>
        <source>{serial} was interrupted in stage {number}, {stage}</source>
        <translation>{serial} 在第 {number} 阶段（{stage}）中断</translation>
    </message>
    <message>
        <source>This run has no completed stage to resume after, or has ended since.</source>
        <translation>这次标定没有已完成的阶段可以接着做，或者已经结束。</translation>
    </message>
    <message>
        <source>Started {when} UTC. Is this unit still in the fixture, untouched?</source>
        <translation>开始于 {when} UTC。这个产品还在夹具上，没有动过吗？</translation>
    </message>
    <message>
        <source>Resume at stage {number}</source>
        <translation>从第 {number} 阶段继续</translation>
    </message>
    <message>
        <source>Close as incomplete</source>
        <translation>按未完成结束</translation>
    </message>
    <message>
        <source>Later</source>
        <translation>以后再说</translation>
    </message>
    <message>
        <source>The run cannot be resumed</source>
        <translation>这次标定无法继续</translation>
    </message>
</context>
<context>
    <name>RunHeader</name>
    <message>
        <source>Press Space or click; Enter does not start, scanners send it.</source>
        <translation>请按空格键或点击；回车不会启动，因为扫码枪会发送回车。</translation>
    </message>
    <message>
        <source>Resume</source>
        <translation>继续</translation>
    </message>
    <message>
        <source>Pause</source>
        <translation>暂停</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>name or badge</source>
        <translation>姓名或工号</translation>
    </message>
    <message>
        <source>scan or type</source>
        <translation>扫描或输入</translation>
    </message>
    <message>
        <source>START</source>
        <translation>开始全参数标定</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
</context>
<context>
    <name>StageList</name>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>not written</source>
        <translation>未写入</translation>
    </message>
    <message>
        <source>solving</source>
        <translation>解算中</translation>
    </message>
    <message>
        <source>ok</source>
        <translation>完成</translation>
    </message>
    <message>
        <source>not ok</source>
        <translation>未通过</translation>
    </message>
    <message>
        <source>stopped</source>
        <translation>已停止</translation>
    </message>
    <message>
        <source>fault</source>
        <translation>故障</translation>
    </message>
    <message>
        <source>not run</source>
        <translation>未做</translation>
    </message>
    <message>
        <source>{time} in all</source>
        <translation>共 {time}</translation>
    </message>
    <message>
        <source>{time} left</source>
        <translation>剩余 {time}</translation>
    </message>
    <message>
        <source>Times of a real table; the virtual bench is much faster.</source>
        <translation>这是真实转台的时间，虚拟台架快得多。</translation>
    </message>
</context>
<context>
    <name>Starting</name>
    <message>
        <source>attempt {count}</source>
        <translation>第 {count} 次</translation>
    </message>
    <message>
        <source>Another page is talking to a device</source>
        <translation>另一页面正在与设备通信</translation>
    </message>
    <message>
        <source>Writing the registers of {serial} was interrupted</source>
        <translation>向 {serial} 写寄存器时中断</translation>
    </message>
    <message>
        <source>It takes a few seconds; then press START again.</source>
        <translation>需要几秒钟，完成后请再按一次“开始全参数标定”。</translation>
    </message>
    <message>
        <source>Which registers shall the unit have before it is calibrated? New ones are verified first with a turn of the table.</source>
        <translation>标定之前，产品里应当是哪一组寄存器？新的一组会先用转台转动来验证。</translation>
    </message>
    <message>
        <source>Which registers shall the unit have before it is calibrated?</source>
        <translation>标定之前，产品里应当是哪一组寄存器？</translation>
    </message>
    <message>
        <source>The old ones, then calibrate</source>
        <translation>恢复原有的，再标定</translation>
    </message>
    <message>
        <source>The new ones, then calibrate</source>
        <translation>写完新的，再标定</translation>
    </message>
    <message>
        <source>not valid</source>
        <translation>无效</translation>
    </message>
    <message>
        <source>The serial number &apos;{serial}&apos; does not fit this product</source>
        <translation>序列号“{serial}”不符合这个产品</translation>
    </message>
    <message>
        <source>The serial number is missing</source>
        <translation>缺少序列号</translation>
    </message>
    <message>
        <source>Scan it again, or choose the product that belongs to the unit. Its pattern is {pattern}</source>
        <translation>请重新扫描，或选择与产品对应的型号。序列号规则是 {pattern}</translation>
    </message>
    <message>
        <source>{serial} has already passed</source>
        <translation>{serial} 已经合格</translation>
    </message>
    <message>
        <source>On {when} UTC. Calibrate it once more?</source>
        <translation>时间 {when} UTC。要再标定一次吗？</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>再标定一次</translation>
    </message>
    <message>
        <source>Allow one more</source>
        <translation>再允许一次</translation>
    </message>
    <message>
        <source>Engineer …</source>
        <translation>工程师…</translation>
    </message>
    <message>
        <source>Set {serial} aside</source>
        <translation>请把 {serial} 放到一边</translation>
    </message>
    <message>
        <source>It was outside its limits {count} times in a row. </source>
        <translation>它已连续 {count} 次超出限差。</translation>
    </message>
    <message>
        <source>Allow one more attempt?</source>
        <translation>再允许一次吗？</translation>
    </message>
    <message>
        <source>An engineer can allow one more attempt.</source>
        <translation>工程师可以再允许一次。</translation>
    </message>
    <message>
        <source>The table of &apos;{station}&apos; is going to move</source>
        <translation>“{station}”的转台即将转动</translation>
    </message>
    <message>
        <source>Is everyone clear of the table and the unit secured?</source>
        <translation>人员都已离开转台了吗？产品固定牢了吗？</translation>
    </message>
    <message>
        <source>All clear, start</source>
        <translation>已确认，开始</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
</context>
<context>
    <name>TablePanel</name>
    <message>
        <source>outer</source>
        <extracomment>Opacity of a table whose angles are unknown. Half of the width of the drawing, ring radii. Corners of the unit&apos;s box on the disc, along two directions of the disc and its normal, ring radii.</extracomment>
        <translation>外框</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>table not connected</source>
        <translation>转台未连接</translation>
    </message>
    <message>
        <source>table moving</source>
        <translation>转台转动</translation>
    </message>
    <message>
        <source>table at rest</source>
        <translation>转台静止</translation>
    </message>
</context>
<context>
    <name>Traces</name>
    <message>
        <source>Gyro, °/s</source>
        <extracomment>Ticks kept, a quarter of an hour of device time. Interval between two drawings, ms. Spans that can be chosen, s.</extracomment>
        <translation>陀螺，°/s</translation>
    </message>
    <message>
        <source>Accelerometer, m/s²</source>
        <translation>加表，m/s²</translation>
    </message>
    <message>
        <source>Holds the plot; the run and its recording go on.</source>
        <translation>画面定格，标定和记录照常进行。</translation>
    </message>
    <message>
        <source>10 s</source>
        <translation>10 秒</translation>
    </message>
    <message>
        <source>1 min</source>
        <translation>1 分钟</translation>
    </message>
    <message>
        <source>10 min</source>
        <translation>10 分钟</translation>
    </message>
    <message>
        <source>Hold</source>
        <translation>定格</translation>
    </message>
    <message>
        <source>device time before now, s</source>
        <translation>距现在的设备时间，s</translation>
    </message>
</context>
<context>
    <name>VerdictPanel</name>
    <message>
        <source>Understood</source>
        <translation>知道了</translation>
    </message>
    <message>
        <source>Details</source>
        <extracomment>Least height of the head, px. Most height of a row of figures, px. Height of the shape in the head, as a fraction of the head.</extracomment>
        <translation>详情</translation>
    </message>
    <message>
        <source>Open the station page</source>
        <translation>打开工位页</translation>
    </message>
    <message>
        <source>Where: {place}</source>
        <translation>位置：{place}</translation>
    </message>
    <message>
        <source>attempt {count}</source>
        <translation>第 {count} 次</translation>
    </message>
    <message>
        <source>{time} of table time</source>
        <translation>转台时间 {time}</translation>
    </message>
    <message>
        <source>registers written and read back, effect not verified</source>
        <translation>寄存器已写入并回读一致，效果未能核对</translation>
    </message>
    <message>
        <source>registers written and verified</source>
        <translation>寄存器已写入并核对</translation>
    </message>
    <message>
        <source>nearest to its limit</source>
        <translation>最接近限差的</translation>
    </message>
    <message>
        <source>value</source>
        <translation>值</translation>
    </message>
    <message>
        <source>sigma</source>
        <translation>标准差</translation>
    </message>
    <message>
        <source>limit</source>
        <translation>限差</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
</context>
</TS>
